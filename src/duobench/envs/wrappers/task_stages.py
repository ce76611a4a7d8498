"""Stages: the task's constraints turned into reward, termination and info."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from duobench.envs.duo_env import Info, Observation, Transition
from duobench.envs.wrappers.base import DuoWrapper
from duobench.stages.progress import Progress


class TaskStages(DuoWrapper):
    """Judges every control step after physics.

    The reward is stage / last stage, and the episode terminates at the last stage. Info holds
    `stage`, `max_stage`, `success` (the same as `is_success`), `success_at_end` (whether the last
    stage's constraints hold right now), `current_subinstruction` (what to do next) and
    `stage_to_subinstructions` (what to do at each stage to reach the next one).
    """

    def __init__(self, env: gym.Env) -> None:
        """Wrap an environment.

        Args:
            env: A `DuoEnv`, wrapped or not.
        """
        super().__init__(env)
        self.progress = Progress(self.base.definition.stages)
        """The stage of the running episode."""
        self._subinstructions: dict[int, str] = {}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode at stage 0."""
        observation, info = self.env.reset(seed=seed, options=options)
        base = self.base
        self.progress.reset(base.simulation, base.layout.variants)
        self._subinstructions = base.definition.subinstructions(base.layout)
        self._tell(info)
        return observation, info

    def step(self, action: Any) -> Transition:
        """Advance one control step and judge it."""
        observation, _, terminated, truncated, info = self.env.step(action)
        progress = self.progress
        stage = progress.update(self.base.simulation)
        self._tell(info)
        reward = stage / progress.max_stage
        return observation, reward, terminated or progress.success, truncated, info

    def _tell(self, info: Info) -> None:
        progress = self.progress
        success = progress.success
        info["success"] = success
        info["is_success"] = success
        info["success_at_end"] = progress.final_holds
        info["stage"] = progress.stage
        info["max_stage"] = progress.max_stage
        # Once the task is solved, what was to be done last is still the answer.
        info["current_subinstruction"] = self._subinstructions[
            min(progress.stage, progress.max_stage - 1)
        ]
        info["stage_to_subinstructions"] = self._subinstructions.copy()
