"""Time limits: how long a policy may take for one answer, and for one episode."""

from __future__ import annotations

import mmap
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from numpy.typing import ArrayLike

from duobench.errors import EvaluationError, PolicyTimeoutError
from duobench.policy import Policy, PolicyMetadata, as_chunk
from duobench.policy.serving.address import MAX_S

T = TypeVar("T")

_TIMES = struct.Struct("dd")
_NO_FILE = -1
_HEALTH_CHECK_S = 10.0
"""Seconds of a time limit that are kept for looking after a server."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeLimits:
    """How long a policy may take; making it, with all its weights, has no limit."""

    act_s: float = 120.0
    """Seconds for one `reset` or one `act`: minutes, because a first answer may compile a model."""
    episode_s: float = 1800.0
    """Seconds for an episode; it is checked whenever the policy is asked."""

    def __post_init__(self) -> None:
        """Reject limits that are not positive."""
        if not (self.act_s > 0 and self.episode_s > 0):
            raise EvaluationError(
                f"Time limits are positive, got {self.act_s} s for an answer and {self.episode_s} "
                "s for an episode."
            )

    @property
    def served_s(self) -> float:
        """Seconds for one answer of a served policy.

        It is less than `act_s`: the rest is for finding out whether a late server still lives.
        """
        return min(max(self.act_s - _HEALTH_CHECK_S, self.act_s / 2), MAX_S)

    def late_answer(self) -> PolicyTimeoutError:
        """The error of a policy that takes too long to answer."""
        return PolicyTimeoutError(
            f"The policy did not answer within {self.act_s:g} s, its limit for one reset or act."
        )

    def late_episode(self) -> PolicyTimeoutError:
        """The error of a policy that takes too long altogether."""
        return PolicyTimeoutError(
            f"The episode was not over after {self.episode_s:g} s, its time limit."
        )


class EpisodeClock:
    """Since when an episode runs, and since when its policy is busy.

    The two times lie in shared memory, so that another process sees them even while a policy keeps
    this one from doing anything at all.
    """

    SIZE = _TIMES.size
    """Bytes that it takes."""

    def __init__(self, file: int = _NO_FILE) -> None:
        """Make a clock.

        Args:
            file: Descriptor of a memory file of `SIZE` bytes that another process has too.
        """
        self._memory = mmap.mmap(file, self.SIZE)

    def _times(self) -> tuple[float, float]:
        return _TIMES.unpack_from(self._memory)

    def start_episode(self) -> None:
        """An episode begins."""
        _TIMES.pack_into(self._memory, 0, time.monotonic(), 0.0)

    def end_episode(self) -> None:
        """The episode is over."""
        _TIMES.pack_into(self._memory, 0, 0.0, 0.0)

    def start_answer(self) -> None:
        """The policy begins to think."""
        _TIMES.pack_into(self._memory, 0, self._times()[0], time.monotonic())

    def end_answer(self) -> None:
        """The policy has answered."""
        _TIMES.pack_into(self._memory, 0, self._times()[0], 0.0)

    @contextmanager
    def answering(self) -> Iterator[None]:
        """The policy thinks as long as the block lasts."""
        self.start_answer()
        try:
            yield
        finally:
            self.end_answer()

    def episode_s(self) -> float:
        """Seconds since the episode began, 0 between episodes."""
        since = self._times()[0]
        return time.monotonic() - since if since else 0.0

    def answer_s(self) -> float:
        """Seconds since the policy was asked, 0 while it is not busy."""
        since = self._times()[1]
        return time.monotonic() - since if since else 0.0


class TimedPolicy:
    """A policy whose answers are timed and checked; a late one is an error once it comes."""

    def __init__(
        self, policy: Policy, limits: TimeLimits, clock: EpisodeClock, action_size: int
    ) -> None:
        """Wrap a policy.

        Args:
            policy: The policy.
            limits: How long it may take.
            clock: Where its times are noted.
            action_size: Numbers of one action.
        """
        self._policy = policy
        self._limits = limits
        self._clock = clock
        self._action_size = action_size

    @property
    def metadata(self) -> PolicyMetadata:
        """That of the policy."""
        return self._policy.metadata

    @property
    def intended_action(self) -> ArrayLike | None:
        """What the policy wanted its last action to be, if it disturbs its own."""
        return getattr(self._policy, "intended_action", None)

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode.

        Raises:
            PolicyTimeoutError: It took too long.
        """
        self._timed(lambda: self._policy.reset(instruction, seed))

    def act(self, observation: Mapping[str, Any]) -> ArrayLike:
        """The policy's next actions, as a checked array; the check may wait for a lazy one.

        Raises:
            PolicyTimeoutError: It took too long, or the episode did.
            PolicyError: It is no chunk of actions.
        """
        return self._timed(lambda: as_chunk(self._policy.act(observation), self._action_size))

    def _timed(self, call: Callable[[], T]) -> T:
        with self._clock.answering():
            answer = call()
            if self._clock.answer_s() > self._limits.act_s:
                raise self._limits.late_answer()
        if self._clock.episode_s() > self._limits.episode_s:
            raise self._limits.late_episode()
        return answer
