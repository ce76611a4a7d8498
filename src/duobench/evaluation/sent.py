"""Finished episodes once more: what was sent is played again, before whoever wants to see it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace

import gymnasium as gym

from duobench.data.replay import command_config
from duobench.envs.config import EnvConfig
from duobench.envs.execution import Step, execute
from duobench.envs.make import make_env
from duobench.errors import ActionError, BackendError, EvaluationError
from duobench.evaluation.rollout import Watcher
from duobench.randomness import SUITE_VERSION
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import TaskInfo
from duobench.tasks import catalog
from duobench.types import Array


def check_suite(run: Run) -> None:
    """Refuse a run whose targets lead elsewhere in this version.

    Raises:
        EvaluationError: The run is of another suite version.
    """
    if run.suite.version != SUITE_VERSION:
        raise EvaluationError(
            f"The run is of suite {run.suite.version}; this version plays suite {SUITE_VERSION}, "
            "in which what was sent leads elsewhere. Show it with the version that played it."
        )


class SentPlayer:
    """Plays finished episodes of one task again; the environment is made once."""

    def __init__(
        self, task: TaskInfo, *, look_every: int | None = None, import_tasks: bool = False
    ) -> None:
        """Remember what to play.

        Args:
            task: The task of a run.
            look_every: Control steps after which the images of the policy are rendered; None for no
                images at all.
            import_tasks: Whether to import the task if it is not of the benchmark.
        """
        is_known = task.id in catalog.names()
        self._task = task
        self._reference = task.id if is_known else task.reference if import_tasks else None
        self._look_every = look_every
        self._env: gym.Env | None = None
        self._config: EnvConfig | None = None

    def environment(self, record: EpisodeRecord) -> gym.Env:
        """The environment that a record is played in, with what was sent as its actions.

        Raises:
            EvaluationError: Its task is not to be imported.
            DuoBenchError: It cannot be made.
        """
        if self._reference is None:
            raise EvaluationError(f"The task {self._task.reference!r} is none of the benchmark.")
        config = command_config(record.config)
        if self._look_every is not None:
            config = replace(config, cameras=record.config.cameras, look=record.config.look)
        if self._env is None or self._config != config:
            self.close()
            self._env, self._config = make_env(self._reference, **asdict(config)), config
        return self._env

    def play(self, record: EpisodeRecord, watcher: Watcher) -> None:
        """Play an episode before a watcher.

        Raises:
            EvaluationError: What was sent is not known, cannot be played, or leads to other stages
                here; or its task is not to be imported.
            DuoBenchError: The environment cannot be made, or the watcher cannot do its work.
        """
        env = self.environment(record)
        try:
            targets = record.targets()
            reached = None if targets is None else self._show(env, record, targets, watcher)
        except (EvaluationError, ActionError, BackendError) as error:
            raise EvaluationError(f"What was sent cannot be played: {error}") from error
        finally:
            watcher.on_episode_end(None)
        if reached is None:
            raise EvaluationError("Its record does not have what was sent.")
        if reached != record.stage_changes:
            raise EvaluationError(
                "What was sent leads to other stages here than its record says, as it may with "
                "other versions of MuJoCo or NumPy, or on another kind of processor."
            )

    def close(self) -> None:
        """Free the environment."""
        if self._env is not None:
            self._env.close()
        self._env = None

    def _show(
        self, env: gym.Env, record: EpisodeRecord, targets: Array, watcher: Watcher
    ) -> tuple[tuple[int, int], ...]:
        """Show an episode, and return when which stage was reached."""
        observation, info = env.reset(seed=record.seed)
        watcher.on_episode_start(env, observation, info)
        reached = [(0, info["stage"])] if info["stage"] else []
        for step in _steps(env, targets, self._look_every or max(len(targets), 1)):
            watcher.on_step(step)
            if (stage := step.info["stage"]) > (reached[-1][1] if reached else 0):
                reached.append((step.number, stage))
        return tuple(reached)


def _steps(env: gym.Env, targets: Array, chunk: int) -> Iterator[Step]:
    """Every control step; images are rendered after each chunk, for whoever acts then."""
    for start in range(0, len(targets), chunk):
        for step in execute(env, targets[start : start + chunk], before=start, render_last=True):
            yield step
            if step.is_last:
                return
