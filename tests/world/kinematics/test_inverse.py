"""Inverse kinematics: tools reach poses, within ranges and velocity limits."""

import math
from itertools import product

import daqp
import mink
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import ARM_JOINTS, SIDES, Side
from duobench.world.kinematics.inverse import (
    ELBOW,
    GRID,
    LIMIT_MARGIN,
    MAX_CHANGE,
    REACH,
    STRAIGHT,
    ArmKinematics,
    Kinematics,
    within_reach,
)
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.joints import JOINT_RANGES, VELOCITY_LIMITS
from duobench.world.robot.mounts import HOME_JOINTS
from duobench.world.scene.arms import kinematic_model
from duobench.world.scene.naming import tcp_name

DT = 1 / 30


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics(ROBOT)


def down(x: float, y: float, z: float, yaw: float = 0.0) -> SE3:
    turn = SE3.about((0, 0, 1), yaw) @ SE3.about((1, 0, 0), math.pi)
    return SE3(turn.rotation, np.array([x, y, z]))


def test_home_is_where_the_facts_say(kinematics: Kinematics) -> None:
    for side, pose in kinematics.forward(HOME_JOINTS).items():
        assert pose.translation == pytest.approx([0.51, 0.21 * side.sign, 0.54], abs=0.01)
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
    for x, y in product((0.35, 0.5, 0.7), (0.0, 0.2, 0.4)):
        goal = down(x, side.sign * y, 0.05, yaw=side.sign * 0.4)
        joints, solved = kinematics.solve(HOME_JOINTS, {side: goal})
        assert solved, (x, y)
        assert max(kinematics.forward(joints)[side].distance(goal)) < 1e-3
        assert np.array_equal(joints[side.other.index], HOME_JOINTS[side.other.index])
    _, solved = kinematics.solve(HOME_JOINTS, {side: down(2.0, 0.0, 0.3)}, max_steps=20)
    assert not solved, "out of reach"


def poses(rng: np.random.Generator, low: list[float], high: list[float]) -> dict[Side, SE3]:
    """A pose of any orientation for each side, in a box of the table frame; y grows outwards."""
    goals = {}
    for side in SIDES:
        x, y, z = rng.uniform(low, high)
        turn = SE3.about(rng.normal(size=3), rng.uniform(0, math.pi))
        goals[side] = SE3(turn.rotation, np.array([x, side.sign * y, z]))
    return goals


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("box", ["near", "far"])
def test_towards_still_targets_the_joints_come_to_rest(
    kinematics: Kinematics, seed: int, box: str
) -> None:
    rng = np.random.default_rng(seed)
    low, high = ([0.2, 0.0, 0.0], [0.8, 0.5, 0.6]) if box == "near" else ([-2] * 3, [3, 2, 2])
    goals = poses(rng, low, high)
    joints = rng.uniform(*JOINT_RANGES.T, size=(2, ARM_JOINTS))
    for _ in range(300):
        joints = kinematics.step(joints, goals)
    for _ in range(30):
        moved = kinematics.step(joints, goals)
        assert np.abs(moved - joints).max() < 0.01 * DT
        joints = moved


def test_a_stretched_arm_comes_back(kinematics: Kinematics) -> None:
    joints = np.array(HOME_JOINTS)
    start = kinematics.forward(joints)[Side.LEFT]
    for x, steps in ((3.0, 120), (0.0, 60)):
        for _ in range(steps):
            joints = kinematics.step(joints, {Side.LEFT: start.moved(x=x)})
        tool = kinematics.forward(joints)[Side.LEFT].translation
        assert (tool[0] > 0.9) == (x > 0.0)
    assert kinematics.forward(joints)[Side.LEFT].distance(start)[0] < 0.001


def test_a_target_out_of_reach_is_brought_within() -> None:
    for side in SIDES:
        for direction in np.vstack([np.eye(3), -np.eye(3)]):
            far = SE3(np.eye(3), ROBOT.shoulders[side] + 5.0 * direction)
            wrist = within_reach(ROBOT, side, far) @ ROBOT.link7_from_tcp.inverse()
            assert np.linalg.norm(wrist.translation - ROBOT.shoulders[side]) == pytest.approx(REACH)
            assert np.array_equal(wrist.rotation, far.rotation)
        near = down(0.5, 0.2 * side.sign, 0.1)
        assert within_reach(ROBOT, side, near) is near


def test_steps_stay_within_ranges_and_velocity_limits_and_elbows_bend_one_way(
    kinematics: Kinematics,
) -> None:
    rng = np.random.default_rng(2)
    joints = np.array(HOME_JOINTS)
    low, high = JOINT_RANGES.T
    for _ in range(20):
        goals = poses(rng, [-2] * 3, [3, 2, 2])
        for _ in range(20):
            moved = kinematics.step(joints, goals)
            assert np.all(np.abs(moved - joints) <= np.array(VELOCITY_LIMITS) * DT)
            assert np.all((moved >= low - 1e-9) & (moved <= high + 1e-9))
            assert (moved[:, ELBOW] <= STRAIGHT + 1e-9).all()
            joints = moved


def test_where_the_solver_finds_nothing_the_arms_stay(
    kinematics: Kinematics, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(daqp, "solve", lambda *_: (np.ones(ARM_JOINTS), 0.0, -1, {}))
    moved = kinematics.step(HOME_JOINTS, {side: down(0.5, 0.0, 0.3) for side in SIDES})
    assert np.abs(moved - HOME_JOINTS).max() <= 0.5 / GRID


@pytest.mark.parametrize("with_before", [False, True])
def test_a_step_is_what_mink_finds_with_its_own_tasks(*, with_before: bool) -> None:
    rng = np.random.default_rng(6)
    model = kinematic_model(Side.LEFT, ROBOT)
    configuration, arm = mink.Configuration(model), ArmKinematics(Side.LEFT, ROBOT)
    tool = mink.FrameTask(tcp_name(Side.LEFT), "site", 1.0, 0.3, lm_damping=0.1)
    posture = mink.PostureTask(model, cost=5e-3, gain=0.05)
    inertia = mink.PostureTask(model, cost=0.02)
    for _ in range(20):
        start = HOME_JOINTS[0] + 0.1 * rng.normal(size=ARM_JOINTS)
        last = 1e-3 * rng.normal(size=ARM_JOINTS)
        goal = arm.forward(start).moved(*2e-3 * rng.normal(size=3))
        configuration.update(start)
        pose = np.concatenate([goal.wxyz, goal.translation])
        tool.set_target(mink.SE3(pose))
        posture.set_target(HOME_JOINTS[0])
        inertia.set_target(start + last)
        tasks = [tool, posture, inertia] if with_before else [tool, posture]
        speed = mink.solve_ik(configuration, tasks, DT, "daqp", damping=1e-5, limits=[])
        before = (start - last)[None] if with_before else None
        found = arm.step(start[None], [pose], DT, HOME_JOINTS[0], before)[0]
        assert np.abs(found - start - speed * DT).max() < 1e-9


def test_a_tool_tracks_a_moving_target(kinematics: Kinematics) -> None:
    joints = np.array(HOME_JOINTS)
    start = kinematics.forward(joints)[Side.LEFT]
    for step in range(90):
        s = 1.0 - math.cos(step * DT)
        goal = start.moved(x=0.10 * s, y=0.05 * s * s, z=-0.15 * s)
        joints = kinematics.step(joints, {Side.LEFT: goal})
        assert kinematics.forward(joints)[Side.LEFT].distance(goal)[0] < 1e-4


def test_a_side_without_a_target_stays(kinematics: Kinematics) -> None:
    moved = kinematics.step(HOME_JOINTS, {Side.RIGHT: down(0.5, -0.2, 0.3)})
    assert np.array_equal(moved[0], HOME_JOINTS[0])
    assert not np.array_equal(moved[1], HOME_JOINTS[1])
    assert np.array_equal(kinematics.step(HOME_JOINTS, {}), HOME_JOINTS)


def test_a_solver_remembers_nothing_and_solutions_are_on_a_grid_that_float32_holds(
    kinematics: Kinematics,
) -> None:
    goals = {side: down(0.5, 0.2 * side.sign, 0.3) for side in SIDES}
    first = kinematics.step(HOME_JOINTS, goals)
    kinematics.solve(HOME_JOINTS + 0.2, {Side.RIGHT: down(0.6, -0.1, 0.1)})
    assert np.array_equal(kinematics.step(HOME_JOINTS, goals), first)
    assert np.array_equal(Kinematics(ROBOT).step(HOME_JOINTS, goals), first)
    assert np.array_equal(first * GRID, np.rint(first * GRID))
    assert np.array_equal(first.astype(np.float32), first)


def test_robots_side_by_side_get_what_each_gets_alone(kinematics: Kinematics) -> None:
    rng = np.random.default_rng(8)
    joints = HOME_JOINTS + 0.2 * rng.normal(size=(12, 2, ARM_JOINTS))
    joints[:4] = HOME_JOINTS
    at = [kinematics.forward(each) for each in joints]
    # Some rest, some come near, some are told to go where no arm reaches.
    ways = np.repeat([0.0, 1e-5, 0.02, 2.0], 3)
    goals = [
        {side: at[number][side].moved(*way * rng.normal(size=3)) for side in SIDES}
        for number, way in enumerate(ways)
    ]
    numbers = np.array([[each[side].tquat for side in SIDES] for each in goals])
    for _ in range(8):
        alone = [
            kinematics.step(each, {side: SE3.from_tquat(row[side.index]) for side in SIDES})
            for each, row in zip(joints, numbers, strict=True)
        ]
        joints = kinematics.step_all(joints, numbers)
        assert np.array_equal(joints, alone)


def test_with_the_step_before_no_joint_jumps_or_turns_about(kinematics: Kinematics) -> None:
    rng = np.random.default_rng(4)
    before = joints = np.array(HOME_JOINTS)
    low, high = JOINT_RANGES.T
    for _ in range(20):
        goals = poses(rng, [0.2, 0.0, 0.0], [0.8, 0.5, 0.6])
        for _ in range(15):
            moved = kinematics.step(joints, goals, before=before)
            step, last = moved - joints, joints - before
            assert np.abs(step - last).max() <= MAX_CHANGE + 2.0 / GRID
            turned = np.minimum(np.abs(step), np.abs(last))[step * last < 0.0]
            assert turned.max(initial=0.0) <= MAX_CHANGE / 2 + 1.0 / GRID
            assert np.minimum(moved - low, high - moved).min() >= LIMIT_MARGIN - 1.0 / GRID
            before, joints = joints, moved
