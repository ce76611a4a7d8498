"""Wrappers for start, stages and end of an episode: random resets, judge, horizon."""

from dataclasses import replace
from typing import Any, Protocol

import gymnasium as gym

from duobench.core.errors import OptionError, check_known
from duobench.core.randomness import EVAL, SPLITS, instruction_number
from duobench.envs.config import (
    INSTRUCTION,
    LAYOUT,
    LAYOUT_SEED,
    OF_SIMULATION,
    SPLIT,
    checked_reset_options,
    checked_seed,
)
from duobench.envs.duo_env import (
    ClosedEnvError,
    DuoWrapper,
    Info,
    ResetNeededError,
    ResetOptions,
    Start,
    Transition,
    base_of,
)
from duobench.envs.episode_state import EpisodeState, required
from duobench.envs.rewards import (
    DENSE,
    PROGRESS,
    REWARDS,
    STAGE,
    reward_of,
)
from duobench.tasks.stages.logic import Words
from duobench.tasks.stages.progress import ProgressState

SEEDS = 2**32
"""A reset without a seed samples one below this number."""


class RandomizedReset(DuoWrapper):
    """Samples a layout of the task, a pure function of (task, suite version, split, seed).

    Without a seed the next one comes from the environment's own generator, so that a seeded reset
    decides all episodes after it. The options of `SimEnv` may give the seed of the layout, or the
    layout itself, and the instruction, which is sampled by the seed too where it varies.

    Args:
        env: A `SimEnv`, wrapped or not.
        split: Which layouts a reset samples from unless its options name a `split`: "eval", or
            "train" for demonstrations.
        varied_instructions: Whether an episode's instruction is sampled from the task's own and
            its paraphrases. An episode whose layout is given, not sampled, has the task's own.

    Raises:
        TypeError: There is no simulation inside.
        UnknownNameError: There is no such split.
        OptionError: The task has no paraphrases to sample from.
    """

    def __init__(
        self, env: gym.Env, split: str = EVAL, *, varied_instructions: bool = False
    ) -> None:
        super().__init__(env)
        base = base_of(env)
        if not hasattr(base, "simulation"):
            raise TypeError(
                f"Expected a simulated environment, which lays its objects out, got "
                f"{type(base).__name__}."
            )
        check_known("split", split, SPLITS)
        self._split = split
        self._is_varied = varied_instructions
        if varied_instructions and not self.base.definition.paraphrases:
            raise OptionError(
                f"Task {self.task!r} has no paraphrases, so its instructions cannot vary; give "
                "them as `paraphrases` of the task."
            )

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode.

        Info also holds `seed` and `split`, from which the layout was sampled; both are None for a
        layout that was given. Errors are those of `SimEnv`.
        """
        options = checked_reset_options(options, OF_SIMULATION)
        used = split = None
        if options.get(LAYOUT) is None:
            used = options.get(LAYOUT_SEED)
            if used is None:
                used = self.np_random.integers(SEEDS) if seed is None else seed
            options[LAYOUT_SEED] = checked_seed(used)
            split = options.setdefault(SPLIT, self._split)
            if self._is_varied and options.get(INSTRUCTION) is None:
                count = len(self.base.definition.instructions)
                number = instruction_number(
                    self.task, options[LAYOUT_SEED], count, split
                )
                options[INSTRUCTION] = number
        observation, info = self.env.reset(seed=seed, options=options)
        info["seed"], info[SPLIT] = None if used is None else int(used), split
        return observation, info


class Judge(Protocol):
    """Judge of the stage that an episode has reached: the simulation, or a person.

    One that can say why the next stage is not reached also has `explain(on)`, which prepares it,
    and after every step `unmet`, the reasons in words; one that sees what is lost has `standing`,
    the stage from which to go on; one that measures has `near()`, how near the next stage is. See
    `stages.progress.Progress`.
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

    The reward is stage / last stage or what a step adds to it, see `rewards.reward_of`, and the
    episode terminates at the last stage. Info holds
    `stage`, `max_stage`, `success` (the same as `is_success`), `success_at_end` (whether the last
    stage's constraints hold right now), `current_subinstruction` (what to do now) and
    `stage_to_subinstructions` (what to do at each stage to reach the next one).

    Args:
        judge: Who says which stage is reached; the simulation where none is given.
        reward: What a step pays, one of `REWARDS`.

    Raises:
        UnknownNameError: A stage names what is not there, or there is no such reward; near misses
            are listed.
        TypeError: There is neither a judge nor a simulation.
        OptionError: The reward is "dense", and the judge measures nothing, as a person does.
    """

    def __init__(
        self, env: gym.Env, judge: Judge | None = None, *, reward: str = STAGE
    ) -> None:
        check_known("reward", reward, REWARDS)
        super().__init__(env, reward=reward)
        self._reward = reward
        base: Any = self.base
        if judge is None and not hasattr(base, "make_judge"):
            what = f"got {type(base).__name__} without one"
            raise TypeError(f"Expected a simulated environment or a judge, {what}.")
        self.judge: Judge = judge or base.make_judge()
        """Judge of the stage that is reached."""
        if reward == DENSE and not hasattr(self.judge, "near"):
            raise OptionError(
                f'Only the simulation can measure reward="{DENSE}"; "{PROGRESS}" and "{STAGE}" are '
                "paid for stages that a person declares."
            )
        self._near: float = 0
        self._max_stage = self.base.definition.max_stage
        self._subinstructions: dict[int, str] = {}
        self._is_explained = False
        self._is_judged = False

    def explain_stages(self, on: bool = True) -> None:
        """Be able to say in `unmet` why the next stage is not reached, from the next step on."""
        explain = getattr(self.judge, "explain", None)
        if explain:
            explain(on)
            self._is_explained = on

    @property
    def unmet(self) -> Words | None:
        """Reason why the last step did not reach the next stage, if `explain_stages` prepared it.

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
        self._measure()
        self._subinstructions = self.base.subinstructions
        self._report(info)
        return observation, info

    def step(self, action: Any) -> Transition:
        """Advance one control step and have it judged."""
        self._is_judged = False
        before = self.judge.stage + self._near
        observation, _, terminated, truncated, info = self.env.step(action)
        self.judge.judge()
        self._is_judged = True
        success = self._report(info)
        self._measure()
        after = self.judge.stage + self._near
        reward = reward_of(self._reward, before, after, self._max_stage)
        return observation, reward, terminated or success, truncated, info

    def save_state(self) -> EpisodeState:
        """The state of the wrapped environment, with stage and memories."""
        return replace(super().save_state(), progress=self.judge.get_state())

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, at its stage."""
        progress = required(state.progress, "stages")
        self._is_judged = False
        observation, info = super().restore_state(state)
        self.judge.set_state(progress)
        self._measure()
        self._subinstructions = self.base.subinstructions
        self._report(info)
        return observation, info

    def _measure(self) -> None:
        if self._reward == DENSE:
            self._near = getattr(self.judge, "near")()  # noqa: B009 - not every judge has it

    def _report(self, info: Info) -> bool:
        """Add what is known about progress to info, and return whether the task is solved."""
        stage = self.judge.stage
        success = stage == self._max_stage
        # Once the task is solved, what was to be done last is still the answer.
        standing = min(getattr(self.judge, "standing", stage), self._max_stage - 1)
        info.update(
            success=success,
            is_success=success,
            success_at_end=self.judge.final_holds,
            stage=stage,
            max_stage=self._max_stage,
            current_subinstruction=self._subinstructions[standing],
            stage_to_subinstructions=self._subinstructions.copy(),
        )
        return success


class TimeLimit(DuoWrapper):
    """Truncates an episode, and refuses steps after its end, however it ended.

    It belongs inside action chunks: then it counts control steps, not chunks.

    Args:
        horizon: Control steps after which an episode is cut off.

    Raises:
        ValueError: The horizon is not positive.
    """

    def __init__(self, env: gym.Env, horizon: int) -> None:
        if horizon < 1:
            raise ValueError(f"A horizon is at least one control step, got {horizon}.")
        super().__init__(env, horizon=horizon)
        self._horizon = horizon
        self._steps = 0
        self._over = False

    @property
    def _max_episode_steps(self) -> int:
        """Control steps after which an episode is cut off."""
        return self._horizon

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode and count from zero."""
        result = self.env.reset(seed=seed, options=options)
        self._steps = 0
        self._over = False
        return result

    def allow_step_after_end(self) -> None:
        """Allow one more step after the end: a recording, or a replay, may go on after success."""
        self._over = False

    def save_state(self) -> EpisodeState:
        """The state of the wrapped environment, with the steps so far."""
        return replace(super().save_state(), steps=self._steps, over=self._over)

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, and count on."""
        steps = required(state.steps, "time limit")
        result = super().restore_state(state)
        self._steps = steps
        self._over = state.over
        return result

    def step(self, action: Any) -> Transition:
        """Advance one control step; the last one of the horizon is truncated."""
        if self._over:
            ClosedEnvError.check(self.base.closed)
            raise ResetNeededError(
                "The episode is over; call reset to begin another one."
            )
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        truncated = truncated or self._steps >= self._horizon
        self._over = terminated or truncated
        return observation, float(reward), terminated, truncated, info
