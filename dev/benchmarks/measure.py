"""What a benchmark reports, and how it takes the time."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, slots=True)
class Measurement:
    """One number, and the bar that it has to meet."""

    what: str
    """What was measured."""
    value: float
    """The number itself."""
    unit: str = ""
    """Unit of the number; empty for a ratio."""
    at_most: float | None = None
    """Bar: the number must not be larger."""
    at_least: float | None = None
    """Bar: the number must not be smaller."""

    @property
    def met(self) -> bool:
        """Whether the number meets its bar; true where there is none."""
        return (self.at_most is None or self.value <= self.at_most) and (
            self.at_least is None or self.value >= self.at_least
        )

    @property
    def bar(self) -> str:
        """The bar as text."""
        if self.at_most is not None:
            return f"<= {self.at_most:g}"
        return "" if self.at_least is None else f">= {self.at_least:g}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Work:
    """What is timed, piece by piece, and what has to happen before without being counted."""

    pieces: Sequence[Callable[[], object]]
    """What is timed, in order; the shorter a piece, the likelier it runs undisturbed once."""
    prepare: Callable[[], object] = lambda: None
    """What comes before the first piece."""


def seconds(*works: Work, repeats: int) -> list[float]:
    """Return how long each work takes undisturbed: the shortest time of each piece, summed up.

    Whatever took longer was somebody else's doing: an interrupt, another process, a cold cache.
    Works with the same number of pieces take turns piece by piece, so that all of them see the
    same machine.
    """
    best = [[math.inf] * len(work.pieces) for work in works]
    for _ in range(repeats):
        for work in works:
            work.prepare()
        for number, pieces in enumerate(
            zip(*(work.pieces for work in works), strict=True)
        ):
            for piece, times in zip(pieces, best, strict=True):
                start = time.perf_counter()
                piece()
                times[number] = min(times[number], time.perf_counter() - start)
    return [sum(times) for times in best]
