"""Replaying recorded episodes: their commands through the physics."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np

from duobench.data.recording import Recording
from duobench.envs.action_modes import JOINT
from duobench.envs.config import FIXED, LAYOUT, EnvConfig
from duobench.envs.execution import optional_method
from duobench.envs.protocol import make_env
from duobench.envs.sim_env import sim_of
from duobench.errors import ActionError, BackendError, DataError, DuoBenchError
from duobench.looks.catalog import DEFAULT
from duobench.randomness import SUITE_VERSION
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


class Replayer:
    """Replays episodes of one task; the environment is made once."""

    def __init__(self, task: str | Task) -> None:
        """Find the task.

        Args:
            task: The task, its id, or its import path.

        Raises:
            UnknownNameError: There is no such task.
        """
        self._task = catalog.get(task)
        self._env: gym.Env | None = None
        self._config: EnvConfig | None = None

    def replay(self, recording: Recording) -> Divergence:
        """Run the commands that were sent through the physics, from the recorded layout on.

        With the versions of MuJoCo and DuoBench that recorded them, every state is the same to the
        last bit on every x86-64 processor; on another architecture contacts amplify the last bit.

        Raises:
            DataError: The recording is of another task or suite, or cannot be begun, or its
                commands are no numbers.
        """
        first: int | None = None
        stages: list[int] = []
        largest = 0.0
        try:
            for row, (state, agent_pos, stage) in enumerate(self._rows(recording)):
                if first is None and not np.array_equal(state, recording.state[row]):
                    first = row
                largest = max(largest, float(np.abs(agent_pos - recording.agent_pos[row]).max()))
                stages.append(stage)
        except BackendError:
            first = len(stages) if first is None else first
        except ActionError as error:
            raise DataError(f"The commands cannot be replayed: {error}") from error
        return Divergence(
            steps=len(stages) - 1,
            first=first,
            largest=largest,
            recorded_stage=int(recording.stage.max()),
            stage=max(stages),
            same_stages=stages == recording.stage.tolist(),
        )

    def close(self) -> None:
        """Free the environment."""
        if self._env is not None:
            self._env.close()

    def _rows(self, recording: Recording) -> Iterator[tuple[np.ndarray, np.ndarray, int]]:
        """State, proprioception and stage of every row of the replay."""
        env = self._environment(recording)
        simulation = sim_of(env).simulation
        try:
            observation, info = env.reset(options={LAYOUT: recording.info.layout})
        except DuoBenchError as error:
            raise DataError(f"The episode cannot be begun: {error}") from error
        yield simulation.get_state(), observation["agent_pos"], info["stage"]
        allow = optional_method(env, "allow_step_after_end")
        for command in recording.sent:
            allow()  # a recording may go on after success
            observation, *_, info = env.step(command)
            yield simulation.get_state(), observation["agent_pos"], info["stage"]

    def _environment(self, recording: Recording) -> gym.Env:
        """An environment that takes the commands as they were sent."""
        info = recording.info
        if info.task != self._task.id:
            raise DataError(f"The episode is of task {info.task!r}, not of {self._task.id!r}.")
        if info.suite_version != SUITE_VERSION:
            raise DataError(
                f"The episode is of suite {info.suite_version}; this version has suite "
                f"{SUITE_VERSION}, in which its commands lead elsewhere."
            )
        config = replace(
            command_config(info.config or EnvConfig()), horizon=sys.maxsize, instructions=FIXED
        )
        if self._env is None or self._config != config:
            self.close()
            options = {name: getattr(config, name) for name in EnvConfig.__slots__}
            self._env, self._config = make_env(self._task, **options), config
        return self._env


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


def replay_all(task: str | Task, recordings: Iterator[Recording]) -> Iterator[Divergence]:
    """Replay episodes of one task, one after the other; see `Replayer.replay`.

    Args:
        task: The task, its id, or its import path.
        recordings: Their recordings.

    Yields:
        How each differs from its recording.

    Raises:
        UnknownNameError: There is no such task.
        DataError: A recording cannot be replayed.
    """
    with closing(Replayer(task)) as replayer:
        for recording in recordings:
            yield replayer.replay(recording)
