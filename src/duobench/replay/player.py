"""Playing what was recorded again: the one loop, and the environment that it keeps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from typing import Any, Generic, Protocol, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.envs.action_modes import JOINT
from duobench.envs.config import EnvConfig
from duobench.envs.execution import Step, execute, optional_method
from duobench.envs.protocol import make_env
from duobench.errors import EvaluationError, UnknownNameError
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.rollout import Info, Observation, Watcher, watched_by
from duobench.looks.catalog import DEFAULT
from duobench.randomness import SUITE_VERSION
from duobench.results.records import REAL, EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Episode, TaskInfo, find_tasks
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.types import Array

HOLD_TOLERANCE = 1e-3
"""Difference in radians, or parts of an opening, that holding a command may make in action modes
that solve for joints."""


class _Closable(Protocol):
    def close(self) -> None: ...


V = TypeVar("V", bound=_Closable)


class Latest(Generic[V]):
    """What was made last, until something else is needed, before which it is closed."""

    def __init__(self) -> None:
        self._key: object = None
        self._value: V | None = None

    def get(self, key: object, make: Callable[[], V]) -> V:
        """What belongs to a key."""
        if self._value is None or self._key != key:
            self.close()
            self._value, self._key = make(), key
        return self._value

    def close(self) -> None:
        """Close what is there; another one can be made afterwards."""
        value, self._value = self._value, None
        if value is not None:
            value.close()


class Player:
    """Plays commands that were sent again; its environment is kept until another one is needed."""

    def __init__(self) -> None:
        self._latest: Latest[gym.Env] = Latest()

    def environment(self, task: str | Task, config: EnvConfig) -> gym.Env:
        """An environment in a configuration."""
        options = {field.name: getattr(config, field.name) for field in fields(EnvConfig)}
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
                for step in execute(env, part, before=start, render_last=chunk is not None):
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
        self._run, self._import_tasks = run, import_tasks
        self._claimed = {task.id: task for task in run.suite.tasks}
        self._tasks: dict[str, TaskInfo] = {}

    def task(self, record: EpisodeRecord) -> TaskInfo:
        """The task of a record as it is, whatever the run says about it; see `actual_task`."""
        if record.task not in self._tasks:
            claimed = self._claimed[record.task]
            self._tasks[record.task] = actual_task(claimed, import_tasks=self._import_tasks)
        return self._tasks[record.task]

    def environment_of(self, record: EpisodeRecord, *, has_images: bool = False) -> gym.Env:
        """The environment of a record, with the images of its policy or without."""
        config = command_config(record.config)
        if has_images:
            config = replace(config, cameras=record.config.cameras, look=record.config.look)
        return self.environment(self.task(record).reference, config)

    def replay(
        self,
        record: EpisodeRecord,
        watchers: Sequence[Watcher] = (),
        *,
        has_images: bool = False,
        chunk: int | None = None,
    ) -> EpisodeRecord:
        """Play the targets of a record from the episode's own seed on; see `play`.

        Returns:
            The record of that, with the error of the given one.

        Raises:
            EvaluationError: The targets are damaged, cannot have been sent, or are none; or no
                evaluation is configured so.
            DuoBenchError: They cannot be played.
        """
        task, config = self.task(record), record.config
        targets = _targets(record, task)
        episode = Episode(task=task, index=record.episode, split=config.split, shift=config.shift)
        recorder = EpisodeRecorder(episode)
        env = self.environment_of(record, has_images=has_images)
        watching = (recorder, _Sendable(record, targets), *watchers)
        for _ in self.play(env, targets, watching, seed=episode.seed, chunk=chunk):
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


class _Sendable:
    """Watches a replay, and rejects targets that the policy cannot have sent."""

    def __init__(self, record: EpisodeRecord, targets: Array) -> None:
        self._latency = record.execution.latency
        self._first = targets[: self._latency]

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Reject targets that move before the first chunk can have been answered."""
        if not np.allclose(self._first, info["sent"], rtol=0, atol=HOLD_TOLERANCE):
            raise EvaluationError(
                f"It does not hold its command for a latency of {self._latency} steps."
            )

    def on_step(self, step: Step) -> None:
        """Reject a target that was clipped."""
        if not (step.info["sent"] == step.action).all():
            raise EvaluationError(f"The joint targets of step {step.number} exceed a limit.")

    def on_episode_end(self, error: BaseException | None) -> None:
        """Do nothing."""


def _targets(record: EpisodeRecord, task: TaskInfo) -> Array:
    """The targets of a record, no more than fit into an episode of its task."""
    if record.horizon != task.horizon or record.config.horizon is not None:
        claimed = record.config.horizon or record.horizon
        raise EvaluationError(f"The horizon is {claimed}, that of the task is {task.horizon}.")
    targets = record.targets()
    if targets is None:
        raise EvaluationError("There are no joint targets.")
    return targets


def command_config(config: EnvConfig) -> EnvConfig:
    """A configuration in which the commands that were sent in another one are the actions.

    They are joint targets and openings, one command a step; nothing is rendered.
    """
    return replace(
        config,
        action_mode=JOINT.name,
        binary_gripper=False,
        chunk=None,
        cameras=(),
        object_state=False,
        render_mode=None,
        look=DEFAULT,
    )


def actual_task(claimed: TaskInfo, *, import_tasks: bool) -> TaskInfo:
    """A task of a run as it is, whatever the run says about it; see `RecordPlayer`.

    Raises:
        UnknownNameError: It is none of the benchmark, and is not to be imported, or there is none.
        ImportPathError: It cannot be imported.
    """
    reference = claimed.id if claimed.id in catalog.names() else claimed.reference
    if reference != claimed.id and not import_tasks:
        raise UnknownNameError(f"The task {reference!r} is none of the benchmark.")
    (actual,) = find_tasks((reference,))
    return actual


def why_not(record: EpisodeRecord) -> str:
    """Why a record of a known task cannot be played again; empty if it can."""
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
