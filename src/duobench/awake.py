"""How long something takes while this process runs: a job that is suspended makes nobody late."""

import time

LAPSE_S = 2.0
"""Seconds without a note after which a process was stopped, not only busy."""
_KEPT = 100
"""Gaps that are remembered, the latest."""


class Awake:
    """Knows when a process was stopped, by the gaps between notes that come many times a second."""

    def __init__(self) -> None:
        self._noted: tuple[float, tuple[tuple[float, float], ...]] | None = None

    def note(self) -> None:
        """Say that the process runs."""
        now = time.monotonic()
        self._noted = now, self._gaps(now)

    def seconds_since(self, moment: float) -> float:
        """Seconds since a `time.monotonic()`, less those in which the process was stopped.

        All of them where nothing notes that it runs.
        """
        now = time.monotonic()
        stopped = (max(end - max(begin, moment), 0.0) for begin, end in self._gaps(now))
        return now - moment - sum(stopped)

    def _gaps(self, now: float) -> tuple[tuple[float, float], ...]:
        last, gaps = self._noted or (now, ())
        return gaps if now - last <= LAPSE_S else (*gaps, (last, now))[-_KEPT:]


HERE = Awake()
"""Of this process, if it is one of an evaluation: what watches its parent notes it."""
