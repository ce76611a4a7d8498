"""Replay of records of a run and of recordings: one loop, and its users."""

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import (
    ActionError,
    BackendError,
    DataError,
    DuoBenchError,
    EvaluationError,
)
from duobench.core.randomness import SUITE_VERSION
from duobench.core.types import Array
from duobench.data.recording import Recording
from duobench.envs.action_modes import JOINT
from duobench.envs.config import (
    CAMERA_OPTIONS,
    FIXED,
    LAYOUT,
    LAYOUT_SEED,
    SPLIT,
    EnvConfig,
)
from duobench.envs.execution import Step, execute, optional_method
from duobench.envs.protocol import make_env
from duobench.envs.sim_env import sim_of
from duobench.evaluation.episode import Latest
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.rollouts import (
    Info,
    Observation,
    Watcher,
    watched_by,
)
from duobench.results.records import REAL, Record
from duobench.results.run import Run
from duobench.results.suite import Episode, TaskInfo, find_tasks
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.world.looks.catalog import DEFAULT
from duobench.world.sim.simulation import Simulation

HOLD_TOLERANCE = 1e-3
"""Difference in radians, or parts of an opening, that holding a command may make in action modes
that solve for joints."""


class Player:
    """Plays commands that were sent again; its environment is kept until another one is needed."""

    def __init__(self) -> None:
        self._latest: Latest[gym.Env] = Latest()

    def environment(self, task: str | Task, config: EnvConfig) -> gym.Env:
        """An environment in a configuration."""
        options = {
            field.name: getattr(config, field.name) for field in fields(EnvConfig)
        }
        return self._latest.get((task, config), lambda: make_env(task, **options))

    def play(
        self,
        env: gym.Env,
        targets: NDArray[np.floating],
        watchers: Sequence[Watcher] = (),
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
        chunk: int | None = None,
        past_end: bool = False,
    ) -> Iterator[Step]:
        """Play joint targets from a reset on, until the episode is over.

        Args:
            env: The environment of the player.
            targets: Joint targets in radians and openings (steps, 16), one a step.
            watchers: Called in this order; they are told how the episode ended, too.
            seed: Seed of the reset.
            options: Options of the reset.
            chunk: Images are rendered after so many steps each; None switches nothing.
            past_end: Whether to play all targets, wherever the episode ends.

        Yields:
            Each control step, which is played when it is asked for.
        """
        allow = optional_method(env, "allow_step_after_end")
        render = optional_method(env, "set_rendering")
        size = 1 if past_end else chunk or max(1, len(targets))
        with watched_by(watchers):
            render(True)
            observation, info = env.reset(seed=seed, options=options)
            for watcher in watchers:
                watcher.on_episode_start(env, observation, info)
            for start in range(0, len(targets), size):
                if past_end:
                    allow()
                part = targets[start : start + size]
                for step in execute(
                    env, part, before=start, render_last=chunk is not None
                ):
                    for watcher in watchers:
                        watcher.on_step(step)
                    yield step
                    if step.is_last and not past_end:
                        return

    def close(self) -> None:
        """Free the environment."""
        self._latest.close()


class RecordPlayer(Player):
    """Plays episodes of a run again, from the targets in their records, without the policy.

    Args:
        run: The run.
        import_tasks: Whether to import tasks that are not of the benchmark, which runs the code of
            the modules that the run names.
    """

    def __init__(self, run: Run, *, import_tasks: bool = False) -> None:
        super().__init__()
        self._run = run
        claimed = {task.id: task for task in run.suite.tasks}
        self._task = cache(
            lambda task: actual_task(claimed[task], import_tasks=import_tasks)
        )

    def task(self, record: Record) -> TaskInfo:
        """Actual task of a record, not as the run describes it; see `actual_task`."""
        return self._task(record.task)

    def environment_of(self, record: Record, *, has_images: bool = False) -> gym.Env:
        """The environment of a record, with the images of its policy or without."""
        config = command_config(record.config)
        if has_images:
            seen = {name: getattr(record.config, name) for name in CAMERA_OPTIONS}
            config = replace(config, **seen, look=record.config.look)
        return self.environment(self.task(record).reference, config)

    def replay(
        self,
        record: Record,
        watchers: Sequence[Watcher] = (),
        *,
        has_images: bool = False,
        chunk: int | None = None,
    ) -> Record:
        """Play the targets of a record from the episode's own seed on; see `play`.

        Returns:
            The record of that, with the error of the given one.
        """
        task, config = self.task(record), record.config
        if record.horizon != task.horizon or config.horizon is not None:
            claimed = config.horizon or record.horizon
            raise EvaluationError(
                f"The horizon is {claimed}, that of the task is {task.horizon}."
            )
        targets = record.targets()
        if targets is None:
            raise EvaluationError("There are no joint targets.")
        episode = Episode(
            task=task, index=record.episode, split=config.split, shift=config.shift
        )
        recorder = EpisodeRecorder(episode)
        env = self.environment_of(record, has_images=has_images)
        watching = (recorder, _Sendable(record, targets), *watchers)
        for _ in self.play(
            env,
            targets,
            watching,
            seed=episode.seed,
            chunk=chunk,
        ):
            pass
        replay = recorder.record(self._run, record.versions, record.policy)
        if record.error is None:
            return replay
        return replace(
            replay,
            success=False,
            success_at_end=False,
            state_hash=None,
            end=None,
            error=record.error,
        )


class _Sendable(Watcher):
    """Watches a replay, and rejects targets that the policy cannot have sent."""

    def __init__(self, record: Record, targets: Array) -> None:
        self._latency = record.execution.latency
        self._first = targets[: self._latency]

    def on_episode_start(
        self,
        env: gym.Env,  # noqa: ARG002 - the protocol's signature
        observation: Observation,  # noqa: ARG002 - the protocol's signature
        info: Info,
    ) -> None:
        if not np.allclose(
            self._first,
            info["sent"],
            rtol=0,
            atol=HOLD_TOLERANCE,
        ):
            raise EvaluationError(
                f"It does not hold its command for a latency of {self._latency} steps."
            )

    def on_step(self, step: Step) -> None:
        if not (step.info["sent"] == step.action).all():
            raise EvaluationError(
                f"The joint targets of step {step.number} exceed a limit."
            )


def command_config(config: EnvConfig) -> EnvConfig:
    """Configuration whose actions are the commands that were sent under another configuration.

    Actions are joint targets and openings, one for each step; nothing is rendered.
    """
    return replace(
        config,
        action_mode=JOINT.name,
        binary_gripper=False,
        chunk=None,
        cameras=(),
        image_sizes={},
        depth=(),
        segmentation=(),
        object_state=False,
        render_mode=None,
        look=DEFAULT,
    )


def actual_task(claimed: TaskInfo, *, import_tasks: bool) -> TaskInfo:
    """Load the actual task that a run names; its description there may differ."""
    reference = catalog.trusted(
        claimed.id, claimed.reference, import_tasks=import_tasks
    )
    (actual,) = find_tasks((reference,))
    return actual


def why_not(record: Record) -> str:
    """Reason why a record of a known task cannot be played again; empty if it can."""
    if record.domain == REAL:
        return "It was played on real arms and judged by a person, which cannot be played again."
    if record.suite_version != SUITE_VERSION:
        return (
            f"It is an episode of suite {record.suite_version}; this version plays suite "
            f"{SUITE_VERSION}."
        )
    if record.error is not None and record.start is None:
        return "Its policy failed before the episode began."
    if record.sent is None and record.error is not None:
        return "Its policy was stopped, so that its joint targets are not known."
    if record.sent is None:
        return "It has no joint targets."
    return ""


# --- recordings ----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Divergence:
    """Differences between an episode replayed by its commands and the recorded one."""

    steps: int
    """Control steps that were replayed."""
    first: int | None
    """First row whose state differs in any bit; None if all are the same."""
    largest: float
    """Largest difference of a joint position or an opening, in radians or parts of 1."""
    recorded_stage: int
    stage: int
    same_stages: bool
    """Whether every stage was reached at the same step."""

    @property
    def is_exact(self) -> bool:
        """Whether states and stages are the same to the last bit."""
        return self.first is None and self.same_stages


def replay(task: str | Task, recordings: Iterable[Recording]) -> Iterator[Divergence]:
    """Run the commands that were sent through the physics again, from the recorded layouts on.

    With the versions of MuJoCo and DuoBench that recorded them, every state is the same to the
    last bit on every x86-64 processor; on another architecture contacts amplify the last bit.

    Args:
        task: The task, its id, or its import path.
        recordings: Recordings of it, one after the other.

    Yields:
        How each replayed episode differs from its recording.

    Raises:
        UnknownNameError: There is no such task.
        DataError: A recording is of another task or suite, or cannot be begun, or its commands
            are no numbers.
    """
    definition = catalog.get(task)
    with closing(Player()) as player:
        for recording in recordings:
            env = player.environment(definition, _config(definition, recording))
            yield _divergence(player, env, recording)


def _config(task: Task, recording: Recording) -> EnvConfig:
    """A configuration that takes the commands of a recording as they were sent."""
    info = recording.info
    if info.task != task.id:
        raise DataError(f"The episode is of task {info.task!r}, not of {task.id!r}.")
    if info.suite_version != SUITE_VERSION:
        raise DataError(
            f"The episode is of suite {info.suite_version}; this version has suite "
            f"{SUITE_VERSION}, in which its commands lead elsewhere."
        )
    config = command_config(info.config or EnvConfig())
    return replace(config, horizon=sys.maxsize, instructions=FIXED)


def _divergence(
    player: Player,
    env: gym.Env,
    recording: Recording,
) -> Divergence:
    comparison, info = _StateComparison(recording), recording.info
    options: dict[str, Any] = {LAYOUT: info.layout}
    if info.seed is not None:  # what shifts sample follows from it
        options |= {LAYOUT_SEED: info.seed, SPLIT: info.split}
    try:
        # A recording may go on after success.
        for _ in player.play(
            env,
            recording.sent,
            [comparison],
            options=options,
            past_end=True,
        ):
            pass
    except DuoBenchError as error:
        if not comparison.stages:
            raise DataError(f"The episode cannot be begun: {error}") from error
        if isinstance(error, ActionError):
            raise DataError(f"The commands cannot be replayed: {error}") from error
        if not isinstance(error, BackendError):
            raise
        if comparison.first is None:
            comparison.first = len(comparison.stages)
    return Divergence(
        steps=len(comparison.stages) - 1,
        first=comparison.first,
        largest=comparison.largest,
        recorded_stage=int(recording.stage.max()),
        stage=max(comparison.stages),
        same_stages=comparison.stages == recording.stage.tolist(),
    )


class _StateComparison(Watcher):
    """Watches a replay, and compares each of its rows with the recorded one."""

    _simulation: Simulation

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.first: int | None = None
        self.stages: list[int] = []
        self.largest = 0.0

    def on_episode_start(
        self, env: gym.Env, observation: Observation, info: Info
    ) -> None:
        self._simulation = sim_of(env).simulation
        self._compare(observation, info)

    def on_step(self, step: Step) -> None:
        self._compare(step.observation, step.info)

    def _compare(self, observation: Observation, info: Info) -> None:
        row, recorded = len(self.stages), self._recording
        state = self._simulation.get_state()
        if self.first is None and not np.array_equal(state, recorded.state[row]):
            self.first = row
        difference = np.abs(observation["agent_pos"] - recorded.agent_pos[row]).max()
        self.largest = max(self.largest, float(difference))
        self.stages.append(info["stage"])
