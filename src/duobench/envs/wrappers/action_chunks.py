"""Action chunks: several actions executed in one step."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from duobench.envs import spaces
from duobench.envs.duo_env import Transition
from duobench.envs.execution import execute
from duobench.envs.wrappers.base import DuoWrapper
from duobench.types import Array


class ActionChunks(DuoWrapper):
    """Executes n actions one after the other, and stops early when the episode ends.

    The observation and info are those after the last executed action. The reward is the sum, so
    that returns do not depend on chunks; `info["rewards"]` (n,) holds the single ones, zero where
    no action was executed, `info["executed"]` counts the executed actions, and `info["clipped"]`
    says what was clipped in any of them.
    """

    def __init__(self, env: gym.Env, length: int) -> None:
        """Wrap an environment.

        Args:
            env: A `DuoEnv`, wrapped or not; cameras belong outside, then they render once a chunk.
            length: Actions in one chunk.

        Raises:
            ValueError: The length is not positive.
        """
        if length < 1:
            raise ValueError(f"A chunk has at least one action, got {length}.")
        super().__init__(env, length=length)
        self._length = length
        single = env.action_space
        if not isinstance(single, gym.spaces.Box):
            raise TypeError(f"Chunks are made of actions in a Box, got {single}.")
        self.action_space = gym.spaces.Box(
            np.tile(single.low, (length, 1)), np.tile(single.high, (length, 1)), dtype=np.float32
        )
        self._shape = (length, *single.shape)
        self._check_one = env.get_wrapper_attr("check_action")
        # Images that are taken once a step play in real time at this rate.
        self.metadata = {**env.metadata, "render_fps": env.metadata["render_fps"] / length}

    def check_action(self, action: Any) -> Array:
        """The chunk as float64 numbers (n, actions), without executing it.

        Raises:
            ActionError: It has another shape, or the environment would reject one of the actions.
        """
        return np.array([self._check_one(row) for row in spaces.numbers(action, self._shape)])

    def step(self, action: Any) -> Transition:
        """Execute the chunk, until its end or the episode's.

        Raises:
            ActionError: See `check_action`. Nothing was moved.
        """
        done = list(execute(self.env, self.check_action(action)))
        rewards = np.zeros(self._length)
        rewards[: len(done)] = [step.reward for step in done]
        last = done[-1]
        info = {
            **last.info,
            "clipped": np.any([step.info["clipped"] for step in done], axis=0),
            "rewards": rewards,
            "executed": len(done),
        }
        return last.observation, float(rewards.sum()), last.terminated, last.truncated, info
