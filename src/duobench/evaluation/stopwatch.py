"""What the time of an episode is spent on."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import gymnasium as gym

from duobench.envs.duo_env import base_of
from duobench.results.reporting.times import EpisodeTimes
from duobench.sim.backend import SimBackend


class Stopwatch:
    """Measures one episode, from now on."""

    def __init__(self) -> None:
        """Begin with the whole."""
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
        """What was measured so far.

        Args:
            video_s: Seconds of the rollout that its video took.
            busy_s: Seconds that the policy took for its answers; None if only the time until they
                came is known.
        """
        busy_s = self._policy if busy_s is None else min(busy_s, self._policy)
        return EpisodeTimes(
            total=time.perf_counter() - self._start,
            simulation=max(0.0, self._rollout - self._rendering - self._policy - video_s),
            rendering=self._rendering,
            policy=busy_s,
            waiting=self._policy - busy_s,
            video=video_s,
        )


def _rendering_s(env: gym.Env) -> float:
    """Seconds that the images of an environment have taken; 0 where they come from real cameras."""
    backend = base_of(env).backend
    return backend.rendering_s if isinstance(backend, SimBackend) else 0.0
