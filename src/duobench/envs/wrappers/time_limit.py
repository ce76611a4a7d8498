"""The horizon: an episode is cut off after a number of control steps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym

from duobench.envs.duo_env import ResetNeededError, ResetOptions, Start, Transition
from duobench.envs.episode_state import EpisodeState, required
from duobench.envs.wrappers.base import DuoWrapper


class TimeLimit(DuoWrapper):
    """Truncates an episode, and refuses steps after its end, however it ended.

    It belongs inside action chunks: then it counts control steps, not chunks.
    """

    def __init__(self, env: gym.Env, horizon: int) -> None:
        """Wrap an environment.

        Args:
            env: A `DuoEnv`, wrapped or not.
            horizon: Control steps after which an episode is cut off.

        Raises:
            ValueError: The horizon is not positive.
        """
        if horizon < 1:
            raise ValueError(f"A horizon is at least one control step, got {horizon}.")
        super().__init__(env, horizon=horizon)
        self._horizon = self._limit = horizon
        self._steps = 0
        self._over = False

    @property
    def _max_episode_steps(self) -> int:
        """Control steps after which an episode is cut off."""
        return self._horizon

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode and count from zero."""
        result = self.env.reset(seed=seed, options=options)
        self._limit, self._steps, self._over = self._horizon, 0, False
        return result

    def play_on(self, limit: int) -> None:
        """Let an episode that the horizon has cut off go on, up to so many control steps in all."""
        self._limit, self._over = limit, False

    def allow_step_after_end(self) -> None:
        """Allow one more step after the end, which says again that the episode is over.

        For a recording that goes on after success, and for the replay of one.
        """
        self._over = False

    def save_state(self) -> EpisodeState:
        """The state of the wrapped environment, with the steps so far."""
        return replace(super().save_state(), steps=self._steps, over=self._over)

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, and count on.

        Raises:
            StateError: The state was saved without a time limit.
        """
        steps = required(state.steps, "time limit")
        result = super().restore_state(state)
        self._limit, self._steps, self._over = self._horizon, steps, state.over
        return result

    def step(self, action: Any) -> Transition:
        """Advance one control step; the last one of the horizon is truncated.

        Raises:
            ResetNeededError: The episode is over.
        """
        if self._over:
            raise ResetNeededError("The episode is over; call reset to begin another one.")
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        truncated = truncated or self._steps >= self._limit
        self._over = terminated or truncated
        return observation, float(reward), terminated, truncated, info
