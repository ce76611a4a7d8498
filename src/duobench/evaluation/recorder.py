"""The subscriber that turns a rollout into a record."""

from __future__ import annotations

import sys
import traceback
from pathlib import Path
from typing import Any

import gymnasium as gym

from duobench.envs.sim_env import sim_of
from duobench.evaluation.loop import Info, Observation, Step
from duobench.evaluation.records import EpisodeRecord
from duobench.evaluation.suite import Trial
from duobench.randomness import SUITE_VERSION
from duobench.sim.simulation import Simulation

LONGEST_LINE = 400
"""Characters of a traceback's line that are kept."""


class Recorder:
    """Keeps what the record of one episode needs, whether or not the episode ends well."""

    def __init__(self, trial: Trial) -> None:
        """Begin with an episode of which nothing is known but its place in the suite."""
        self._trial = trial
        self._simulation: Simulation | None = None
        self._instruction = ""
        self._layout: dict[str, Any] = {}
        self._stage = 0
        self._stage_changes: list[tuple[int, int]] = []
        self._last: Step | None = None
        self._fingerprint: str | None = None

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Note what the reset drew."""
        self._simulation = sim_of(env).simulation
        self._instruction = info["instruction"]
        self._layout = dict(info["layout"])
        self._note_stage(0, info["stage"])

    def on_step(self, step: Step) -> None:
        """Note a stage that was newly reached."""
        self._last = step
        self._note_stage(step.number, step.info["stage"])

    def on_episode_end(self) -> None:
        """Note the final state."""
        if self._simulation is not None:
            self._fingerprint = self._simulation.fingerprint()

    def _note_stage(self, number: int, stage: int) -> None:
        if stage > self._stage:
            self._stage = stage
            self._stage_changes.append((number, stage))

    def record(
        self, policy: str, versions: dict[str, str | None], error: str | None = None
    ) -> EpisodeRecord:
        """The record of the episode.

        Args:
            policy: Name under which the policy was asked for.
            versions: What `record_versions` gave.
            error: Traceback of what broke the episode.
        """
        task, last = self._trial.task, self._last
        return EpisodeRecord(
            suite_version=SUITE_VERSION,
            task=task.id,
            episode=self._trial.episode,
            seed=self._trial.seed,
            policy=policy,
            instruction=self._instruction,
            success=self._stage == task.max_stage and error is None,
            success_at_end=bool(last and last.info["success_at_end"]) and error is None,
            final_stage=self._stage,
            max_stage=task.max_stage,
            stage_changes=tuple(self._stage_changes),
            steps=last.number if last else 0,
            horizon=task.horizon,
            terminated=bool(last and last.terminated),
            truncated=bool(last and last.truncated),
            error=error,
            layout=self._layout,
            fingerprint=self._fingerprint,
            versions=versions,
        )


def traceback_text(error: BaseException) -> str:
    """A traceback whose files are named from the folder they were imported from.

    The text is then the same in every checkout, and tells nothing about a machine. Lines that go
    on and on, such as those with a printed array, are cut.
    """
    text = "".join(traceback.format_exception(error))
    folders = sorted({str(Path(entry).resolve()) for entry in sys.path}, key=len, reverse=True)
    for folder in folders:
        text = text.replace(f'File "{folder}/', 'File "')
    return "".join(
        line if len(line) <= LONGEST_LINE else f"{line[:LONGEST_LINE]} …\n"
        for line in text.splitlines(keepends=True)
    )
