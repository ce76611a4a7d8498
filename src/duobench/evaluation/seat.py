"""Where episodes are played: one environment, one policy, one task at a time."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import gymnasium as gym

from duobench.envs.registration import make
from duobench.envs.sim_env import sim_of
from duobench.errors import RenderingError
from duobench.evaluation import policies
from duobench.evaluation.film import Film, FilmError, filming
from duobench.evaluation.folder import RunFolder
from duobench.evaluation.loop import Subscriber, rollout
from duobench.evaluation.recorder import Recorder, traceback_text
from duobench.evaluation.records import EpisodeRecord, write_record
from duobench.evaluation.run import Run, TaskInfo
from duobench.evaluation.suite import Trial
from duobench.evaluation.versions import record_versions
from duobench.policy import Policy
from duobench.policy.compatibility import check_fits
from duobench.scene.cameras import OVERVIEW
from duobench.sim.rendering import Renderer, describe

VIDEO_SIZE = (480, 640)
"""Height and width of a video in pixels."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Played:
    """An episode that was played, with what is not part of its record."""

    record: EpisodeRecord
    """The record, which is already written."""
    seconds: float | None
    """How long it took on the wall, film included; None if nobody knows."""

    def note(self) -> dict[str, Any]:
        """As a line of the timing notes."""
        return {
            "task": self.record.task,
            "episode": self.record.episode,
            "steps": self.record.steps,
            "seconds": None if self.seconds is None else round(self.seconds, 3),
        }


class Seat:
    """Plays episodes of a run, one after the other, and writes their records."""

    def __init__(self, run: Run, folder: RunFolder) -> None:
        """Look the policy up; environments are made when they are needed.

        Args:
            run: What is played.
            folder: Where records and videos go.

        Raises:
            PolicyError: If the policy cannot be made.
        """
        self._run = run
        self._folder = folder
        self._source = policies.source(run.policy)
        renderer = describe().renderer if self._source.metadata.cameras else None
        self._versions = record_versions(renderer)
        self._task: TaskInfo | None = None
        self._env: gym.Env | None = None
        self._policy: Policy | None = None
        self._renderer: Renderer | None = None

    def prepare(self, task: TaskInfo) -> tuple[gym.Env, Policy]:
        """Environment and policy of a task; those of another task are closed first.

        Raises:
            DuoBenchError: If the environment cannot be made.
            PolicyError: If the policy does not fit it.
        """
        if self._env is None or self._policy is None or self._task != task:
            self.close()
            metadata = self._source.metadata
            size = {} if metadata.image_size is None else {"image_size": metadata.image_size}
            self._env = make(
                task.reference,
                cameras=tuple(metadata.cameras),
                action_mode=metadata.action_mode,
                **size,
            )
            self._policy = self._source.bind(self._env)
            check_fits(self._policy.metadata, self._env)
            self._task = task
        return self._env, self._policy

    def play(self, trial: Trial) -> Played:
        """Play one episode and write its video, if it is to be filmed, then its record.

        An exception from the environment or the policy, `sys.exit` included, makes the episode a
        failed one, and the run goes on; what is wrong with the machine, such as graphics that do
        not work, ends the run instead.
        """
        start = time.perf_counter()
        env, policy = self.prepare(trial.task)
        recorder = Recorder(trial)
        error = None
        with ExitStack() as stack:
            subscribers: list[Subscriber] = [recorder]
            if self._run.is_filmed(trial.episode):
                path = self._folder.video(trial.task.id, trial.episode)
                subscribers.append(stack.enter_context(self._filming(path)))
            try:
                rollout(env, policy, seed=trial.seed, subscribers=subscribers)
            except (RenderingError, FilmError):
                raise
            except (Exception, SystemExit) as caught:  # noqa: BLE001 - kept in the record
                error = traceback_text(caught)
        record = recorder.record(self._run.policy, self._versions, error)
        write_record(self._folder.record(trial.task.id, trial.episode), record)
        if error is not None:
            self.close()  # whatever broke may have left the environment in any state
        return Played(record=record, seconds=time.perf_counter() - start)

    def _filming(self, path: Path) -> AbstractContextManager[Film]:
        """A film of the simulation that is being played, from the camera for people."""
        simulation = sim_of(cast("gym.Env", self._env)).simulation
        if self._renderer is None:
            height, width = VIDEO_SIZE
            self._renderer = Renderer(simulation.model, height=height, width=width)
        renderer = self._renderer
        return filming(path, lambda: renderer.render(simulation.data, OVERVIEW))

    def close(self) -> None:
        """Free the environment and the renderer; closing twice is harmless."""
        if self._renderer is not None:
            self._renderer.close()
        if self._env is not None:
            self._env.close()
        self._renderer = self._env = self._policy = self._task = None
