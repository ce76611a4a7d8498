"""An episode on arms that are plain numbers, judged by a person: played, recorded and reported.

`tests.test_without_mujoco` runs this in a process that cannot import the simulator.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from duobench.core.types import DuoCommand
from duobench.core.versions import package_versions, record_versions
from duobench.data import Actor, DataSet, Recorder, Recording
from duobench.envs import (
    ActionChunks,
    BinaryGripper,
    Cameras,
    DuoEnv,
    EnvConfig,
    ObjectStates,
    RelativeJointActions,
    TaskStages,
    TimeLimit,
)
from duobench.evaluation import rollout
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.policy import PolicyMetadata
from duobench.results.folder import RunFolder
from duobench.results.report import write_report
from duobench.results.run import Candidate, Run, TimeLimits
from duobench.results.scores import Results
from duobench.results.suite import Suite, find_tasks
from duobench.tasks import catalog
from duobench.tasks.stages.progress import ProgressState
from tests.envs.number_arms import NumberArms

TASK = "bin_sort"
IMAGE_SIZE = (4, 6)
STAGES = {2: 1, 5: 3, 8: 5}
"""Stage that the person has seen after so many control steps."""
CONFIG = EnvConfig(
    action_mode="joint_relative", binary_gripper=True, cameras=("head",), image_size=IMAGE_SIZE
)


class Clockwork(NumberArms):
    """Number arms with a clock."""

    def command(self, command: DuoCommand) -> DuoCommand:
        self.time += 1 / 30
        return super().command(command)


class Person:
    """Says the stage after each step."""

    def __init__(self) -> None:
        self.stage = self.steps = 0

    @property
    def final_holds(self) -> bool:
        return self.stage == max(STAGES.values())

    def begin(self) -> None:
        self.stage = self.steps = 0

    def judge(self) -> None:
        self.steps += 1
        self.stage = STAGES.get(self.steps, self.stage)

    def get_state(self) -> ProgressState:
        return ProgressState(stage=self.stage)

    def set_state(self, state: ProgressState) -> None:
        self.stage = state.stage


class Creep:
    """Opens and closes the grippers, and turns all joints on by a little; in chunks of two."""

    metadata = PolicyMetadata(
        name="creep", cameras=("head",), image_size=IMAGE_SIZE, action_mode="joint_relative"
    )

    def reset(self, instruction: str, seed: int) -> None:
        assert instruction
        assert seed

    def act(self, observation: Mapping[str, Any]) -> NDArray[np.float64]:
        assert observation["pixels"]["head"].shape == (*IMAGE_SIZE, 3)
        return np.full((2, 16), 0.01)


def make(data: DataSet) -> gym.Env:
    """Every wrapper but those that need a simulation or inverse kinematics, and a recorder."""
    base = DuoEnv(Clockwork(), catalog.get(TASK))
    base.config = CONFIG
    env = TimeLimit(TaskStages(base, Person()), horizon=50)
    env = Recorder(RelativeJointActions(env), data, Actor(name="creep"))
    return Cameras(BinaryGripper(env), CONFIG.cameras, IMAGE_SIZE)


def play(path: Path) -> tuple[Recording, Results]:
    """Play one episode, and return what its recording and its report hold."""
    run = Run(
        candidates=(Candidate(policy="creep", metadata=Creep.metadata, config=CONFIG),),
        suite=Suite(tasks=find_tasks([TASK]), episodes=1),
        limits=TimeLimits(),
        versions=package_versions(),
    )
    folder, data = RunFolder(path / "run"), DataSet.open(path / "data")
    folder.begin(run)
    (episode,) = run.episodes()
    recorder = EpisodeRecorder(episode)
    env = make(data)
    rollout(env, Creep(), seed=episode.seed, watchers=[recorder])
    folder.write(recorder.record(run, record_versions(None)))
    (recorded,) = data.episodes()
    chunks = ActionChunks(env, 3)
    chunks.reset()
    *_, info = chunks.step(np.zeros((3, 16)))
    assert info["executed"] == 3
    chunks.close()
    return Recording.read(recorded), write_report(folder)


def refusal() -> str:
    """What asking for object states says, which only a simulation has."""
    try:
        ObjectStates(DuoEnv(Clockwork(), catalog.get(TASK)))
    except TypeError as error:
        return str(error)
    return ""
