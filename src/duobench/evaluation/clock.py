"""What the processes of an episode share: how long it runs, and how long its policy is busy."""

from __future__ import annotations

import mmap
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from duobench.errors import PolicyTimeoutError
from duobench.results.limits import TimeLimits

_EPISODE, _ANSWER, _STEPS = range(3)
_NO_FILE = -1


class EpisodeClock:
    """Since when an episode runs, since when its policy is busy, and after how many steps.

    The numbers lie in shared memory, so that another process sees them even while a policy keeps
    this one from doing anything at all.
    """

    SIZE = 3 * 8
    """Bytes that it takes: two doubles and a whole number."""

    def __init__(self, file: int = _NO_FILE) -> None:
        """Make a clock.

        Args:
            file: Descriptor of a memory file of `SIZE` bytes that another process has too.
        """
        memory = memoryview(mmap.mmap(file, self.SIZE))
        self._times, self._counts = memory.cast("d"), memory.cast("q")

    def playing(self) -> AbstractContextManager[None]:
        """An episode runs as long as the block lasts."""
        return self._running(_EPISODE)

    def answering(self) -> AbstractContextManager[None]:
        """The policy thinks as long as the block lasts."""
        return self._running(_ANSWER)

    @contextmanager
    def timed(self, limits: TimeLimits, steps: int = 0) -> Iterator[None]:
        """The policy thinks as long as the block lasts, which is checked at its end.

        Args:
            limits: How long it may take.
            steps: Control steps that the episode has had.

        Raises:
            PolicyTimeoutError: It took too long, or the episode did.
        """
        self._counts[_STEPS] = steps
        with self.answering():
            yield
            if late := self.late(limits):
                raise late

    def late(self, limits: TimeLimits) -> PolicyTimeoutError | None:
        """The error of a policy that has been thinking for too long; None while there is time."""
        if self.answer_s() > limits.act_timeout:
            return PolicyTimeoutError.of_answer(limits.act_timeout)
        if self.answer_s() and self.episode_s() > limits.episode_timeout:
            return PolicyTimeoutError(
                f"The episode was not over after {limits.episode_timeout:g} s, its time limit."
            )
        return None

    @property
    def steps(self) -> int:
        """Control steps that the episode had when its policy last acted."""
        return self._counts[_STEPS]

    def episode_s(self) -> float:
        """Seconds since the episode began, 0 between episodes."""
        return self._seconds(_EPISODE)

    def answer_s(self) -> float:
        """Seconds since the policy was called, 0 while it is not busy."""
        return self._seconds(_ANSWER)

    @contextmanager
    def _running(self, which: int) -> Iterator[None]:
        self._times[which] = time.monotonic()
        try:
            yield
        finally:
            self._times[which] = 0.0

    def _seconds(self, which: int) -> float:
        since = self._times[which]
        return time.monotonic() - since if since else 0.0
