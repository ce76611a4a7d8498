"""Stages: progress turned into reward, termination and info."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym

from duobench.envs.duo_env import Info, Observation, Transition
from duobench.envs.episode_state import EpisodeState, required
from duobench.envs.sim_env import sim_of
from duobench.envs.wrappers.base import DuoWrapper
from duobench.stages.progress import Progress, check_names


class TaskStages(DuoWrapper):
    """Judges every control step by the task's constraints, from the state of the simulation.

    The reward is stage / last stage, and the episode terminates at the last stage. Info holds
    `stage`, `max_stage`, `success` (the same as `is_success`), `success_at_end` (whether the last
    stage's constraints hold right now), `current_subinstruction` (what to do next) and
    `stage_to_subinstructions` (what to do at each stage to reach the next one).
    """

    def __init__(self, env: gym.Env) -> None:
        """Wrap a `SimEnv`, wrapped already or not.

        Raises:
            UnknownNameError: A stage names what is not there; near misses are listed.
            TypeError: There is no simulation inside.
        """
        super().__init__(env)
        self._sim_env = sim_of(env)
        task = self._sim_env.definition
        check_names(task.stages, self._sim_env.simulation, next(task.layouts(0)).variants)
        self._progress = Progress(task.stages)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode at stage 0."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._progress.reset(self._sim_env.simulation, self._sim_env.layout.variants)
        self._report(info)
        return observation, info

    def step(self, action: Any) -> Transition:
        """Advance one control step and judge it."""
        observation, _, terminated, truncated, info = self.env.step(action)
        stage = self._progress.update(self._sim_env.simulation)
        self._report(info)
        reward = stage / self._progress.max_stage
        return observation, reward, terminated or self._progress.success, truncated, info

    def save_state(self) -> EpisodeState:
        """The state of the wrapped environment, with stage and memories."""
        return replace(super().save_state(), progress=self._progress.get_state())

    def restore_state(self, state: EpisodeState) -> tuple[Observation, Info]:
        """Continue from a saved state, at its stage.

        Raises:
            StateError: The state was saved without stages.
        """
        progress = required(state.progress, "stages")
        observation, info = super().restore_state(state)
        self._progress.set_state(progress, self._sim_env.layout.variants)
        self._report(info)
        return observation, info

    def _report(self, info: Info) -> None:
        """Add what is known about progress to info."""
        progress = self._progress
        info["success"] = info["is_success"] = progress.success
        info["success_at_end"] = progress.final_holds
        info["stage"] = progress.stage
        info["max_stage"] = progress.max_stage
        # Once the task is solved, what was to be done last is still the answer.
        todo = self._sim_env.definition.subinstructions(self._sim_env.layout)
        info["current_subinstruction"] = todo[min(progress.stage, progress.max_stage - 1)]
        info["stage_to_subinstructions"] = todo
