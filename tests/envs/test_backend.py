"""Wrappers need a backend, not MuJoCo: they work on arms that are plain numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.backend import DuoLimits, Image
from duobench.envs import (
    ActionChunks,
    BinaryGripper,
    Cameras,
    CartesianActions,
    RandomizedReset,
    RelativeCartesianActions,
    RelativeJointActions,
    TaskStages,
    TimeLimit,
)
from duobench.envs.duo_env import DuoEnv
from duobench.envs.wrappers.task_stages import Judge
from duobench.scene.fr3 import HOME_JOINTS
from duobench.sim.kinematics import Kinematics
from duobench.stages.progress import ProgressState
from duobench.tasks import catalog
from duobench.types import SIDES, DuoCommand, DuoState
from tests.envs.tools import TASK, wave

TASK_DATA = catalog.get(TASK)


class NumberArms:
    """Arms that are at once where they are sent, but never lower their left joint 2."""

    limits = DuoLimits(
        low=np.tile([*[-3.0] * 7, 0.0], 2),
        high=np.tile([*[4.0] * 7, 1.0], 2),
        max_change=np.tile([*[0.1] * 7, np.inf], 2),
    )

    def __init__(self) -> None:
        self.last_command = DuoCommand(joints=HOME_JOINTS, openings=np.ones(2))
        self.images_taken: list[tuple[Sequence[str], tuple[int, int]]] = []
        self.closed = False
        self._kinematics = Kinematics()

    time = 0.0

    def joint_velocities(self) -> np.ndarray:
        return np.zeros((2, 7))

    def read(self) -> DuoState:
        poses = self._kinematics.forward(self.last_command.joints)
        return DuoState(
            joints=self.last_command.joints,
            openings=self.last_command.openings,
            tcp_poses=np.array([poses[side].tquat for side in SIDES]),
        )

    def command(self, command: DuoCommand) -> DuoCommand:
        joints = command.joints.copy()
        joints[0, 1] = max(joints[0, 1], self.last_command.joints[0, 1])
        self.last_command = DuoCommand(joints=joints, openings=command.openings)
        return self.last_command

    def images(self, cameras: Sequence[str], shape: tuple[int, int]) -> Mapping[str, Image]:
        self.images_taken.append((cameras, shape))
        return {name: np.full((*shape, 3), 7, np.uint8) for name in cameras}

    def close(self) -> None:
        self.closed = True


class Person:
    """A judge who raises the stage by one each time that somebody nods."""

    def __init__(self) -> None:
        self.stage, self.final_holds, self.nods = 0, False, 0

    def begin(self) -> None:
        self.stage = 0

    def judge(self) -> None:
        self.stage += self.nods
        self.nods = 0

    def get_state(self) -> ProgressState:
        return ProgressState(stage=self.stage)

    def set_state(self, state: ProgressState) -> None:
        self.stage = state.stage


@pytest.fixture
def arms() -> NumberArms:
    return NumberArms()


@pytest.fixture
def env(arms: NumberArms) -> DuoEnv:
    env = DuoEnv(arms, TASK_DATA)
    env.reset()
    return env


def test_what_was_really_sent_is_reported(env: DuoEnv) -> None:
    action = env.backend.last_command.flat
    action[[1, 3, 7]] += [-0.05, 0.5, -0.4]
    *_, info = env.step(action)
    assert info["sent"] == pytest.approx(env.backend.last_command.flat)
    assert np.flatnonzero(info["clipped"]).tolist() == [1, 3]
    assert info["sent"][3] == pytest.approx(HOME_JOINTS[0, 3] + 0.1)
    assert info["sent"][7] == pytest.approx(0.6)


def test_relative_joint_actions_start_at_what_was_really_sent(env: DuoEnv) -> None:
    relative = RelativeJointActions(env)
    assert relative.action_space.high[0] == pytest.approx(0.1)  # type: ignore[attr-defined]
    down = np.zeros(16)
    down[[1, 2]] = -0.02
    for _ in range(3):
        *_, info = relative.step(down)
    assert info["sent"][1] == pytest.approx(HOME_JOINTS[0, 1])
    assert info["sent"][2] == pytest.approx(HOME_JOINTS[0, 2] - 0.06)


def test_cartesian_actions_move_the_tools(env: DuoEnv) -> None:
    relative = RelativeCartesianActions(CartesianActions(env))
    start = env.backend.read().tcp_poses
    shift = np.zeros(14)
    shift[9] = 0.01
    for _ in range(5):
        observation, *_ = relative.step(shift)
    moved = observation["tcp_pose"].reshape(2, 7)[1, :3] - start[1, :3]
    assert moved == pytest.approx([0.0, 0.0, 0.05], abs=0.002)


def test_a_person_can_judge(arms: NumberArms) -> None:
    person: Judge = Person()
    stages = TaskStages(DuoEnv(arms, TASK_DATA), person)
    stages.explain_stages()
    env = TimeLimit(stages, horizon=50)
    _, info = env.reset()
    assert (info["stage"], info["max_stage"]) == (0, TASK_DATA.max_stage)
    rewards = []
    for nods in (0, 1, 2, 0, 2):
        person.nods = nods  # type: ignore[attr-defined]
        _, reward, terminated, _, info = env.step(wave(0))
        rewards.append(reward)
        assert "unmet" not in info, "a person gives no reasons"
    assert rewards == [0.0, 0.2, 0.6, 0.6, 1.0]
    assert terminated
    assert info["success"]


def test_cameras_chunks_and_grippers(arms: NumberArms) -> None:
    env: gym.Env = BinaryGripper(DuoEnv(arms, TASK_DATA))
    env = Cameras(ActionChunks(env, 3), ("head",), (4, 6))
    observation, _ = env.reset()
    action: Any = np.tile(arms.last_command.flat, (3, 1))
    action[:, 7] = 0.3
    observation, *_, info = env.step(action)
    assert info["executed"] == 3
    assert arms.last_command.openings.tolist() == [0.0, 1.0]
    assert observation["pixels"]["head"].shape == (4, 6, 3)
    assert arms.images_taken == [(("head",), (4, 6))] * 2
    env.close()
    assert arms.closed


def test_only_a_simulation_lays_out_objects_and_judges_them(env: DuoEnv) -> None:
    for wrap in (RandomizedReset, TaskStages):
        with pytest.raises(TypeError, match="simulated environment"):
            wrap(env)
