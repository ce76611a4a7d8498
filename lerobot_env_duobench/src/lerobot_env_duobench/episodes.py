"""One environment, whose seeds are the episodes of DuoBench's evaluation."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

import duobench
from duobench.randomness import episode_seed
from duobench.tasks import catalog


def make(task: str, suite_seeds: bool, options: dict[str, Any]) -> gym.Env:
    """An environment as LeRobot's loop uses it.

    Args:
        task: Id of the task, or its import path "module:ATTRIBUTE".
        suite_seeds: Whether seed n is the n-th episode of the evaluation.
        options: As `duobench.make` takes them.
    """
    return Episodes(duobench.make(task, **options), catalog.get(task).id, suite_seeds)


class Episodes(gym.Wrapper):
    """Plays episode n of a task when it is reset with seed n, and tells the instruction."""

    def __init__(self, env: gym.Env, task: str, suite_seeds: bool) -> None:
        """Wrap an environment of a task."""
        super().__init__(env)
        self.task = task
        """Id of the task."""
        self.task_description = ""
        """The instruction of the running episode."""
        self._suite_seeds = suite_seeds

    @property
    def _max_episode_steps(self) -> int:
        """Control steps after which an episode ends; LeRobot asks for it by this name."""
        return self.env.get_wrapper_attr("_max_episode_steps")

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode."""
        if seed is not None and self._suite_seeds:
            seed = episode_seed(self.task, seed)
        observation, info = self.env.reset(seed=seed, options=options)
        self.task_description = info["instruction"]
        return observation, info
