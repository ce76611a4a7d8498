"""Playing the joint targets of a record again, without the policy that chose them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace

import gymnasium as gym
import numpy as np

from duobench.envs.config import EnvConfig
from duobench.envs.execution import execute
from duobench.envs.protocol import make_env
from duobench.errors import EvaluationError, UnknownNameError
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.rollout import Watcher
from duobench.randomness import SUITE_VERSION
from duobench.replay.recordings import command_config
from duobench.results.records import REAL, EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Episode, TaskInfo, find_tasks
from duobench.tasks import catalog
from duobench.types import Array

HOLD_TOLERANCE = 1e-3
"""Difference in radians, or parts of an opening, that holding a command may make in action modes
that solve for joints."""


class TargetPlayer:
    """Plays records of one task; the environment is made once."""

    def __init__(self, task: TaskInfo) -> None:
        """Remember the task as it is, whatever a run says about it."""
        self._task = task
        self._env: gym.Env | None = None
        self._config: EnvConfig | None = None

    def play(
        self, run: Run, record: EpisodeRecord, watchers: Sequence[Watcher] = ()
    ) -> EpisodeRecord:
        """Play the targets of a record of a run from the episode's own seed on.

        Args:
            run: The run.
            record: The record.
            watchers: Who watches the replay; called in this order.

        Returns:
            The record of that, with the error of the given one.

        Raises:
            EvaluationError: The targets are damaged, cannot have been sent, or are none; or no
                evaluation is configured so.
            DuoBenchError: They cannot be played.
        """
        targets = self._targets(record)
        config = record.config
        episode = Episode(
            task=self._task, index=record.episode, split=config.split, shift=config.shift
        )
        recorder = EpisodeRecorder(episode)
        env = self._environment(record.config)
        observation, info = env.reset(seed=episode.seed)
        _check_latency(record, targets, info["sent"])
        watching = (recorder, *watchers)
        for watcher in watching:
            watcher.on_episode_start(env, observation, info)
        for step, target in zip(execute(env, targets), targets, strict=False):
            if not (step.info["sent"] == target).all():
                raise EvaluationError(f"The joint targets of step {step.number} exceed a limit.")
            for watcher in watching:
                watcher.on_step(step)
        for watcher in watching:
            watcher.on_episode_end(None)
        replay = recorder.record(run, record.versions)
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

    def close(self) -> None:
        """Free the environment."""
        if self._env is not None:
            self._env.close()

    def _targets(self, record: EpisodeRecord) -> Array:
        """The targets, no more than fit into an episode of the task."""
        horizon = self._task.horizon
        if record.horizon != horizon or record.config.horizon is not None:
            claimed = record.config.horizon or record.horizon
            raise EvaluationError(f"The horizon is {claimed}, that of the task is {horizon}.")
        targets = record.targets()
        if targets is None:
            raise EvaluationError("There are no joint targets.")
        return targets

    def _environment(self, config: EnvConfig) -> gym.Env:
        config = command_config(config)
        if self._env is None or self._config != config:
            self.close()
            self._env, self._config = make_env(self._task.reference, **asdict(config)), config
        return self._env


def _check_latency(record: EpisodeRecord, targets: Array, first: Array) -> None:
    """Reject targets that move before the first chunk can have been answered.

    Raises:
        EvaluationError: They do.
    """
    latency = record.execution.latency
    if not np.allclose(targets[:latency], first, rtol=0, atol=HOLD_TOLERANCE):
        raise EvaluationError(f"It does not hold its command for a latency of {latency} steps.")


def actual_task(claimed: TaskInfo, *, import_tasks: bool) -> TaskInfo:
    """A task of a run as it is, whatever the run says about it.

    Args:
        claimed: What the run says.
        import_tasks: Whether to import a task that is not of the benchmark, which runs the code of
            the module that the run names.

    Raises:
        UnknownNameError: It is none of the benchmark, and is not to be imported, or there is none.
        ImportPathError: It cannot be imported.
    """
    reference = claimed.id if claimed.id in catalog.names() else claimed.reference
    if reference != claimed.id and not import_tasks:
        raise UnknownNameError(f"The task {reference!r} is none of the benchmark.")
    (actual,) = find_tasks((reference,))
    return actual


def obstacle(record: EpisodeRecord) -> str:
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
        return "It has no joint targets, as records before schema 4."
    return ""
