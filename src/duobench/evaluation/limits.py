"""Time limits: how long a policy may take for one answer, and for one episode."""

from __future__ import annotations

import mmap
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from duobench.errors import EvaluationError, PolicyTimeoutError
from duobench.policy.serving.address import MAX_S

_EPISODE, _ANSWER, _STEPS = range(3)
_NO_FILE = -1
_ENDLESS_S = 1e9
"""A limit in seconds that is as good as none, for JSON knows no infinity."""
_HEALTH_CHECK_S = 10.0
"""Seconds of a time limit that are kept for looking after a server."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeLimits:
    """How long a policy may take; making it, with all its weights, has no limit."""

    act_s: float = 120.0
    """Seconds for one `reset` or one `act`: minutes, because a first answer may compile a model."""
    episode_s: float = 1800.0
    """Seconds for an episode; it is checked whenever the policy acts."""

    def __post_init__(self) -> None:
        """Reject limits that are not positive; infinite ones become very long."""
        if not (self.act_s > 0 and self.episode_s > 0):
            raise EvaluationError(
                f"Time limits are positive, got {self.act_s} s for an answer and {self.episode_s} "
                "s for an episode."
            )
        object.__setattr__(self, "act_s", min(self.act_s, _ENDLESS_S))
        object.__setattr__(self, "episode_s", min(self.episode_s, _ENDLESS_S))

    @property
    def served_s(self) -> float:
        """Seconds for one answer of a served policy.

        It is less than `act_s`: the rest is for finding out whether a late server still lives.
        """
        return min(max(self.act_s - _HEALTH_CHECK_S, self.act_s / 2), MAX_S)


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
    def timed(self, limits: TimeLimits, steps: int) -> Iterator[None]:
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
        if self.answer_s() > limits.act_s:
            return PolicyTimeoutError(
                f"The policy did not answer within {limits.act_s:g} s, its limit for one reset or "
                "act."
            )
        if self.answer_s() and self.episode_s() > limits.episode_s:
            return PolicyTimeoutError(
                f"The episode was not over after {limits.episode_s:g} s, its time limit."
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
