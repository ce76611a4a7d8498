"""Inverse kinematics: tools reach poses, within ranges and velocity limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from duobench.scene.fr3 import HOME_JOINTS, JOINT_RANGES, VELOCITY_LIMITS
from duobench.sim.kinematics import Kinematics
from duobench.spatial import SE3
from duobench.types import SIDES, Side

DT = 1 / 30


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics()


def down(x: float, y: float, z: float, yaw: float = 0.0) -> SE3:
    turn = SE3.about((0, 0, 1), yaw) @ SE3.about((1, 0, 0), math.pi)
    return SE3(turn.rotation, np.array([x, y, z]))


def test_home_is_where_the_facts_say(kinematics: Kinematics) -> None:
    for side, sign in zip(SIDES, (1, -1), strict=True):
        pose = kinematics.forward(HOME_JOINTS)[side]
        assert pose.translation == pytest.approx([0.51, 0.21 * sign, 0.54], abs=0.01)
        assert pose.rotation[2, 2] == pytest.approx(-math.cos(math.radians(20)), abs=0.01)


def test_arms_are_mirror_images(kinematics: Kinematics) -> None:
    rng = np.random.default_rng(0)
    mirror = np.array([-1, 1, -1, 1, -1, 1, -1])
    for _ in range(10):
        left = HOME_JOINTS[0] + rng.uniform(-0.4, 0.4, size=7)
        poses = kinematics.forward(np.array([left, left * mirror]))
        one, other = poses[Side.LEFT].translation, poses[Side.RIGHT].translation
        assert one * [1, -1, 1] == pytest.approx(other, abs=1e-5)


@pytest.mark.parametrize("side", SIDES)
def test_poses_over_the_arms_half_of_the_table_are_solved(
    kinematics: Kinematics, side: Side
) -> None:
    sign = 1 if side is Side.LEFT else -1
    for x in (0.35, 0.5, 0.7):
        for y in (0.0, 0.2, 0.4):
            goal = down(x, sign * y, 0.05, yaw=sign * 0.4)
            joints, solved = kinematics.solve(HOME_JOINTS, {side: goal})
            assert solved, (x, y)
            assert max(kinematics.forward(joints)[side].distance(goal)) < 1e-3
            assert np.array_equal(joints[side.other.index], HOME_JOINTS[side.other.index])


def test_what_is_out_of_reach_is_not_solved(kinematics: Kinematics) -> None:
    _, solved = kinematics.solve(HOME_JOINTS, {Side.LEFT: down(2.0, 0.0, 0.3)}, max_steps=20)
    assert not solved


def test_steps_stay_within_ranges_and_velocity_limits(kinematics: Kinematics) -> None:
    rng = np.random.default_rng(1)
    joints = np.array(HOME_JOINTS)
    low, high = JOINT_RANGES.T
    for _ in range(25):
        targets = {side: down(*rng.uniform([-1, -1, -0.5], [2, 1, 1.5])) for side in SIDES}
        for _ in range(8):
            moved = kinematics.step(joints, targets)
            assert np.all(np.abs(moved - joints) <= np.array(VELOCITY_LIMITS) * DT)
            assert np.all((moved >= low - 1e-9) & (moved <= high + 1e-9))
            joints = moved


def test_a_side_without_a_target_stays(kinematics: Kinematics) -> None:
    moved = kinematics.step(HOME_JOINTS, {Side.RIGHT: down(0.5, -0.2, 0.3)})
    assert np.array_equal(moved[0], HOME_JOINTS[0])
    assert not np.array_equal(moved[1], HOME_JOINTS[1])
    assert np.array_equal(kinematics.step(HOME_JOINTS, {}), HOME_JOINTS)


def test_a_solver_remembers_nothing(kinematics: Kinematics) -> None:
    goal = {Side.LEFT: down(0.5, 0.2, 0.3)}
    first = kinematics.step(HOME_JOINTS, goal)
    kinematics.solve(HOME_JOINTS + 0.2, {Side.RIGHT: down(0.6, -0.1, 0.1)})
    assert np.array_equal(kinematics.step(HOME_JOINTS, goal), first)
    assert np.array_equal(Kinematics().step(HOME_JOINTS, goal), first)
