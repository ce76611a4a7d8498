"""What a benchmark reports, and how it takes the time."""

import statistics
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
    unit: str
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


def seconds(work: Callable[[], object], *, repeats: int) -> float:
    """Return the median time of one call of `work`, after one call that is not counted."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def seconds_side_by_side(
    first: Callable[[], object], second: Callable[[], object], *, repeats: int
) -> tuple[float, float]:
    """Return the median times of two works, taken in turns, so that both see the same machine."""
    first()
    second()
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats):
        for work, taken in zip((first, second), times, strict=True):
            start = time.perf_counter()
            work()
            taken.append(time.perf_counter() - start)
    return statistics.median(times[0]), statistics.median(times[1])
