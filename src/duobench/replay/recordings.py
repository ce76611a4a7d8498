"""Replaying recorded episodes: their commands through the physics."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np

from duobench.data.recording import Recording
from duobench.envs.config import FIXED, LAYOUT, EnvConfig
from duobench.envs.execution import Step
from duobench.envs.sim_env import sim_of
from duobench.errors import ActionError, BackendError, DataError, DuoBenchError
from duobench.evaluation.rollout import Info, Observation
from duobench.randomness import SUITE_VERSION
from duobench.replay.player import Player, command_config
from duobench.sim.simulation import Simulation
from duobench.tasks import catalog
from duobench.tasks.task import Task


@dataclass(frozen=True, kw_only=True, slots=True)
class Divergence:
    """How an episode that was replayed by its commands differs from the recorded one."""

    steps: int
    """Control steps that were replayed."""
    first: int | None
    """First row whose state differs in any bit; None if all are the same."""
    largest: float
    """Largest difference of a joint position or an opening, in radians or parts of 1."""
    recorded_stage: int
    """Highest stage of the recorded episode."""
    stage: int
    """Highest stage of the replayed one."""
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


def _divergence(player: Player, env: gym.Env, recording: Recording) -> Divergence:
    comparison = _Comparison(recording)
    start = {LAYOUT: recording.info.layout}
    try:
        # A recording may go on after success.
        for _ in player.play(env, recording.sent, [comparison], options=start, past_end=True):
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


class _Comparison:
    """Watches a replay, and compares each of its rows with the recorded one."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._simulation: Simulation | None = None
        self.first: int | None = None
        self.stages: list[int] = []
        self.largest = 0.0

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:
        """Compare the start."""
        self._simulation = sim_of(env).simulation
        self._compare(observation, info)

    def on_step(self, step: Step) -> None:
        """Compare the row after a step."""
        self._compare(step.observation, step.info)

    def on_episode_end(self, error: BaseException | None) -> None:
        """Do nothing: what there was is compared."""

    def _compare(self, observation: Observation, info: Info) -> None:
        if self._simulation is None:
            raise AssertionError("An episode begins before its steps.")
        row, recorded = len(self.stages), self._recording
        if self.first is None and not np.array_equal(
            self._simulation.get_state(), recorded.state[row]
        ):
            self.first = row
        difference = np.abs(observation["agent_pos"] - recorded.agent_pos[row]).max()
        self.largest = max(self.largest, float(difference))
        self.stages.append(info["stage"])
