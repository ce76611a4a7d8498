"""Clocks of an episode: its running time, its policy's busy time, and its parts."""

import mmap
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from duobench.core.errors import PolicyTimeoutError
from duobench.core.machine import HERE, Awake
from duobench.envs.duo_env import base_of
from duobench.results.journal import EpisodeTimes
from duobench.results.run import TimeLimits

_EPISODE, _ACT, _STEPS = range(3)


@dataclass(frozen=True, kw_only=True, slots=True)
class ClockReading:
    """Reading of a clock at a moment."""

    episode_s: float = 0.0
    """Seconds since the episode began, 0 between episodes."""
    act_s: float = 0.0
    """Seconds since the policy was called, 0 while it is not busy."""
    steps: int = 0
    """Control steps that the episode had when its policy last acted."""

    def late(self, limits: TimeLimits) -> PolicyTimeoutError | None:
        """The error of a policy that has been thinking for too long; None while there is time."""
        if self.act_s > limits.act_timeout:
            return PolicyTimeoutError.of_answer(limits.act_timeout)
        if self.act_s and self.episode_s > limits.episode_timeout:
            return PolicyTimeoutError(
                f"The episode was not over after {limits.episode_timeout:g} s, its time limit."
            )
        return None


class EpisodeClock:
    """Since when an episode runs, since when its policy is busy, and after how many steps.

    The numbers lie in shared memory, so that another process sees them even while a policy keeps
    this one from doing anything at all.

    Args:
        file: Descriptor of a memory file of `SIZE` bytes that another process has too; -1 if none
            has.
        awake: Knows when this process was stopped, which counts for nothing.
    """

    SIZE = 3 * 8
    """Bytes that it takes: two doubles and a whole number."""

    def __init__(self, file: int = -1, awake: Awake = HERE) -> None:
        self._awake = awake
        memory = memoryview(mmap.mmap(file, self.SIZE))
        self._times, self._counts = memory.cast("d"), memory.cast("q")

    def playing(self) -> AbstractContextManager[None]:
        """An episode runs as long as the block lasts."""
        return self._running(_EPISODE)

    @contextmanager
    def timed(self, limits: TimeLimits, steps: int = 0) -> Iterator[None]:
        """The policy thinks as long as the block lasts, which is checked at its end.

        Args:
            limits: How long it may take.
            steps: Control steps that the episode has had.
        """
        self._counts[_STEPS] = steps
        with self._running(_ACT):
            yield
            late = self.read().late(limits)
            if late:
                raise late

    def read(self) -> ClockReading:
        """Return its reading now."""
        return ClockReading(
            episode_s=self._seconds(_EPISODE),
            act_s=self._seconds(_ACT),
            steps=self._counts[_STEPS],
        )

    @contextmanager
    def _running(self, which: int) -> Iterator[None]:
        self._times[which] = time.monotonic()
        try:
            yield
        finally:
            self._times[which] = 0.0

    def _seconds(self, which: int) -> float:
        since = self._times[which]
        return self._awake.seconds_since(since) if since else 0.0


class Stopwatch:
    """Measures one episode, from now on."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._rollout = self._rendering = self._policy = 0.0

    @contextmanager
    def rollout(self, env: gym.Env) -> Iterator[None]:
        """The episode is played in the block, by whomever; its images are rendered there too."""
        start, rendered = time.perf_counter(), _rendering_s(env)
        try:
            yield
        finally:
            self._rollout += time.perf_counter() - start
            self._rendering += _rendering_s(env) - rendered

    @contextmanager
    def policy(self, busy: AbstractContextManager[Any]) -> Iterator[None]:
        """The policy is asked in the block, inside another context."""
        start = time.perf_counter()
        try:
            with busy:
                yield
        finally:
            self._policy += time.perf_counter() - start

    def times(self, video_s: float = 0.0, busy_s: float | None = None) -> EpisodeTimes:
        """Return the times that were measured so far.

        Args:
            video_s: Seconds of the rollout that its video took.
            busy_s: Seconds that the policy took for its chunks; None if only the time until they
                came is known.
        """
        busy_s = self._policy if busy_s is None else min(busy_s, self._policy)
        return EpisodeTimes(
            total=time.perf_counter() - self._start,
            simulation=max(
                0.0, self._rollout - self._rendering - self._policy - video_s
            ),
            rendering=self._rendering,
            policy=busy_s,
            waiting=self._policy - busy_s,
            video=video_s,
        )


def _rendering_s(env: gym.Env) -> float:
    """Seconds that the images of an environment have taken; 0 where they come from real cameras."""
    return getattr(base_of(env).backend, "rendering_s", 0.0)
