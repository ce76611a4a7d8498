"""Stages: progress turned into reward, termination and info."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import gymnasium as gym

from duobench.envs.duo_env import Info, ResetOptions, Start, Transition
from duobench.envs.episode_state import EpisodeState, required
from duobench.envs.wrappers.base import DuoWrapper
from duobench.stages.logic import Words
from duobench.stages.progress import ProgressState


class Judge(Protocol):
    """Who says which stage an episode has reached: the simulation, or a person.

    One that can say why the next stage is not reached also has `explain(on)`, which prepares it,
    and after every step `unmet`, the reasons in words; one that sees what is lost has `standing`,
    the stage from which to go on. See `stages.progress.Progress`.
    """

    def begin(self) -> None:
        """An episode has begun."""
        ...

    def judge(self) -> None:
        """A control step is over."""
        ...

    @property
    def stage(self) -> int:
        """The highest stage so far."""
        ...

    @property
    def final_holds(self) -> bool:
        """Whether the last stage's constraints hold right now."""
        ...

    def get_state(self) -> ProgressState:
        """All that the next judgement depends on."""
        ...

    def set_state(self, state: ProgressState) -> None:
        """Continue from a state."""
        ...


class TaskStages(DuoWrapper):
    """Has every control step judged.

    The reward is stage / last stage, and the episode terminates at the last stage. Info holds
    `stage`, `max_stage`, `success` (the same as `is_success`), `success_at_end` (whether the last
    stage's constraints hold right now), `current_subinstruction` (what to do now) and
    `stage_to_subinstructions` (what to do at each stage to reach the next one).
    """

    def __init__(self, env: gym.Env, judge: Judge | None = None) -> None:
        """Wrap an environment.

        Args:
            env: A `DuoEnv`, wrapped or not.
            judge: Who says which stage is reached; the simulation where none is given.

        Raises:
            UnknownNameError: A stage names what is not there; near misses are listed.
            TypeError: There is neither a judge nor a simulation.
        """
        super().__init__(env)
        self.judge = judge or _judge_of(self.base)
        """Who says which stage is reached."""
        self._max_stage = self.base.definition.max_stage
        self._subinstructions: dict[int, str] = {}
        self._is_explained = False
        self._is_judged = False

    def explain_stages(self, on: bool = True) -> None:
        """Be able to say in `unmet` why the next stage is not reached.

        What earlier steps tell, such as how high something was let go, is known of steps from here
        on.
        """
        if explain := getattr(self.judge, "explain", None):
            explain(on)
            self._is_explained = on

    @property
    def unmet(self) -> Words | None:
        """Why the last step did not reach the next stage, where `explain_stages` prepared it.

        Short sentences, one for each constraint of the next stage that does not hold: "block is
        20 mm above mat, not at most 12 mm". None if the last step failed, or nothing was stepped
        yet, or the judge gives no reasons, as a person does.
        """
        is_known = self._is_explained and self._is_judged
        return getattr(self.judge, "unmet", None) if is_known else None

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode at stage 0."""
        self._is_judged = False
        observation, info = self.env.reset(seed=seed, options=options)
        self.judge.begin()
        self._subinstructions = self.base.subinstructions
        self._report(info)
        return observation, info

    def step(self, action: Any) -> Transition:
        """Advance one control step and have it judged."""
        self._is_judged = False
        observation, _, terminated, truncated, info = self.env.step(action)
        self.judge.judge()
        self._is_judged = True
        success = self._report(info)
        reward = self.judge.stage / self._max_stage
        return observation, reward, terminated or success, truncated, info

    def save_state(self) -> EpisodeState:
        """The state of the wrapped environment, with stage and memories."""
        return replace(super().save_state(), progress=self.judge.get_state())

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, at its stage.

        Raises:
            StateError: The state was saved without stages.
        """
        progress = required(state.progress, "stages")
        self._is_judged = False
        observation, info = super().restore_state(state)
        self.judge.set_state(progress)
        self._subinstructions = self.base.subinstructions
        self._report(info)
        return observation, info

    def _report(self, info: Info) -> bool:
        """Add what is known about progress to info, and return whether the task is solved."""
        stage = self.judge.stage
        success = stage == self._max_stage
        info["success"] = success
        info["is_success"] = success
        info["success_at_end"] = self.judge.final_holds
        info["stage"] = stage
        info["max_stage"] = self._max_stage
        # Once the task is solved, what was to be done last is still the answer.
        standing = min(getattr(self.judge, "standing", stage), self._max_stage - 1)
        info["current_subinstruction"] = self._subinstructions[standing]
        info["stage_to_subinstructions"] = self._subinstructions.copy()
        return success


def _judge_of(base: Any) -> Judge:
    """The judge that a simulated environment makes."""
    if not hasattr(base, "make_judge"):
        raise TypeError(
            f"Expected a simulated environment or a judge, got {type(base).__name__} without one."
        )
    return base.make_judge()
