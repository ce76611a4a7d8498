"""What a benchmark reports, and how it takes the time."""

import time
from collections.abc import Callable
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
    """What is timed, and what has to happen before each time without being counted."""

    run: Callable[[], object]
    """What is timed."""
    prepare: Callable[[], object] = lambda: None
    """What comes before, not timed."""


def seconds(*works: Work, repeats: int) -> list[float]:
    """Return the shortest time of each work.

    Whatever took longer was somebody else's doing: an interrupt, another process, a cold cache.
    Several works are taken in turns, so that all of them see the same machine.
    """
    rounds = []
    for _ in range(repeats):
        times = []
        for work in works:
            work.prepare()
            start = time.perf_counter()
            work.run()
            times.append(time.perf_counter() - start)
        rounds.append(times)
    return [min(times) for times in zip(*rounds, strict=True)]
