"""Action modes, binary grippers and chunks: other views of the same 16 numbers."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from duobench.core.errors import ActionError
from duobench.core.spatial import SE3, rotation_about
from duobench.core.types import SIDES, Side
from duobench.envs import (
    ACTION_MODES,
    CartesianActions,
    RelativeCartesianActions,
    RelativeJointActions,
)
from duobench.envs.sim_env import SimEnv
from duobench.tasks import catalog
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.joints import JOINT_RANGES, SERVO_LAG, VELOCITY_LIMITS
from tests.envs.tools import TASK, Make, equal, sim_of, waves

OPENINGS = [7, 15]


def begun(wrap: Any) -> Any:
    env = wrap(SimEnv(catalog.get(TASK)))
    env.reset(seed=0)
    return env


def commanded(env: gym.Env) -> np.ndarray:
    return sim_of(env).simulation.duo.command().flat


def tools(env: gym.Env) -> dict[Side, SE3]:
    """Tool poses at the joints that were last commanded."""
    return Kinematics(ROBOT).forward(sim_of(env).simulation.duo.command().joints)


def poses_of(env: gym.Env) -> np.ndarray:
    """Cartesian action that stays where the arms are commanded to be, grippers open."""
    return np.ravel([[*tools(env)[side].tquat, 1.0] for side in SIDES])


def test_displacements_stop_at_the_range_and_come_back_from_there() -> None:
    env = begun(RelativeJointActions)
    up, down = np.zeros(16), np.zeros(16)
    up[6], down[6] = 2.0, -0.01
    for _ in range(60):
        assert env.step(up)[4]["clipped"][6]
    assert commanded(env)[6] == JOINT_RANGES[6, 1]
    assert not env.step(down)[4]["clipped"][6]
    assert commanded(env)[6] == pytest.approx(JOINT_RANGES[6, 1] - 0.01)


def test_displacements_of_a_joint_that_the_table_blocks_store_nothing_up() -> None:
    env = begun(RelativeJointActions)
    down, back = np.zeros(16), np.zeros(16)
    down[1], back[1] = 0.08, -0.08
    for _ in range(60):
        *_, info = env.step(down)
    measured = sim_of(env).simulation.duo.read().flat[1]
    assert info["clipped"][1]
    assert 0.0 < info["sent"][1] - measured < VELOCITY_LIMITS[1] * SERVO_LAG
    for _ in range(4):
        env.step(back)
    assert sim_of(env).simulation.duo.read().flat[1] < measured


def test_a_pose_is_reached() -> None:
    env = begun(CartesianActions)
    start = tools(env)
    turn = rotation_about((0, 0, 1), 0.3)
    goals = {
        side: SE3(turn @ pose.rotation, pose.translation + np.array([0.05, 0.03, -0.1]))
        for side, pose in start.items()
    }
    action = np.ravel([[*goals[side].tquat, 0.5] for side in SIDES]).astype(np.float32)
    for _ in range(30):
        observation, *_ = env.step(action)
    for side, measured in zip(SIDES, np.split(observation["tcp_pose"], 2), strict=True):
        length, angle = goals[side].distance(SE3.from_tquat(measured))
        assert length < 0.004
        assert angle < 0.02
    assert commanded(env)[OPENINGS] == pytest.approx([0.5, 0.5])


def test_a_far_pose_is_approached_within_the_velocity_limits() -> None:
    env = begun(CartesianActions)
    action = poses_of(env)
    action[[0, 8]] += 0.4
    before = commanded(env)
    env.step(action)
    steps = np.abs(commanded(env) - before)[np.delete(np.arange(16), OPENINGS)]
    assert 0.01 < steps.max() < 5.26 / 30


def test_the_quaternion_is_normalized_and_its_sign_is_free() -> None:
    one, other = begun(CartesianActions), begun(CartesianActions)
    action = poses_of(one)
    scaled = action.copy()
    scaled[[3, 4, 5, 6]] *= -2.0
    one.step(action)
    other.step(scaled)
    assert commanded(one) == pytest.approx(commanded(other), abs=1e-9)


def test_a_zero_quaternion_is_refused_before_anything_moves() -> None:
    env = begun(CartesianActions)
    action = poses_of(env)
    action[11:15] = 0.0
    before = sim_of(env).state_hash()
    with pytest.raises(ActionError, match="right quaternion"):
        env.step(action)
    assert sim_of(env).state_hash() == before


def both(env: SimEnv) -> gym.Env:
    return RelativeCartesianActions(CartesianActions(env))


def shift(left: list[float], right: list[float]) -> np.ndarray:
    return np.array([*left, *[0.0] * (6 - len(left)), 1.0, *right, *[0.0] * (6 - len(right)), 1.0])


def test_displacements_of_tools_add_up_along_the_tables_axes() -> None:
    env = begun(both)
    start = tools(env)
    action = shift([0.002, 0.0, -0.004, 0.0, 0.0, 0.01], [0.0, 0.003])
    for _ in range(20):
        env.step(action)
    end = tools(env)
    left = SE3(
        rotation_about((0, 0, 1), 0.2) @ start[Side.LEFT].rotation,
        start[Side.LEFT].translation + np.array([0.04, 0.0, -0.08]),
    )
    assert max(end[Side.LEFT].distance(left)) < 1e-3
    right = start[Side.RIGHT].moved(y=0.06)
    assert max(end[Side.RIGHT].distance(right)) < 1e-3


STILL = {RelativeJointActions: 0.0, CartesianActions: 1e-4, both: 1e-4}
"""How far in metres or radians arms that shall stay may drift."""


@pytest.mark.parametrize(("wrap", "most"), STILL.items())
def test_staying_is_staying(wrap: Any, most: float) -> None:
    env = begun(wrap)
    action = poses_of(env) if wrap is CartesianActions else np.zeros(env.action_space.shape)
    action[[len(action) // 2 - 1, -1]] = 1.0
    joints, start = commanded(env), tools(env)
    for _ in range(200):
        env.step(action)
    assert most or np.array_equal(commanded(env), joints)
    for side, pose in tools(env).items():
        assert max(pose.distance(start[side])) <= most


@pytest.mark.parametrize("place", [0, 3], ids=["shift", "turn"])
def test_huge_but_finite_displacements_are_clipped(make: Make, place: int) -> None:
    env = make(action_mode="cartesian_relative")
    env.reset(seed=0)
    action = np.zeros(14)
    action[[place, place + 7]] = 1e308
    with np.errstate(all="raise", under="ignore"):
        for _ in range(3):
            assert env.step(action)[0] in env.observation_space


def test_pushing_against_a_limit_stores_nothing_up() -> None:
    env = begun(both)
    for _ in range(60):
        env.step(shift([0.05], []))
    stuck = tools(env)[Side.LEFT].translation
    assert stuck[0] > 0.8, "the arm was not stretched"
    for _ in range(6):
        env.step(shift([-0.02], []))
    assert tools(env)[Side.LEFT].translation[0] < stuck[0] - 0.02


def test_a_reset_forgets_the_last_targets() -> None:
    env = begun(both)
    for _ in range(5):
        env.step(shift([0.01], [0.01]))
    env.reset(seed=0)
    start = tools(env)
    env.step(shift([], []))
    assert max(tools(env)[Side.LEFT].distance(start[Side.LEFT])) < 1e-5


@pytest.mark.parametrize("mode", ACTION_MODES)
def test_openings_are_rounded_in_every_mode(make: Make, mode: str) -> None:
    env = make(action_mode=mode, binary_gripper=True)
    env.reset(seed=0)
    action = np.zeros((2, env.action_space.shape[0] // 2), np.float32)
    action[:, 6] = 1.0  # a unit quaternion where there is one
    action[:, -1] = 0.49, 0.5
    given = action.ravel().copy()
    env.step(given)
    assert commanded(env)[OPENINGS].tolist() == [0.0, 1.0]
    assert np.array_equal(given, action.ravel()), "it is the caller's"


def test_a_chunk_is_its_actions_one_after_the_other(make: Make) -> None:
    env, single = make(chunk=4), make()
    assert equal(env.reset(seed=1), single.reset(seed=1))
    chunk = waves(4)
    chunk[0, 2] = 99.0
    *outcome, info = env.step(chunk)
    ones = [single.step(action) for action in chunk]
    rewards = [float(one[1]) for one in ones]
    assert equal(outcome, [ones[-1][0], sum(rewards), False, False])
    assert (info["executed"], info["rewards"].tolist()) == (4, rewards)
    assert np.flatnonzero(info["clipped"]).tolist() == [2], "in the first of them"
    assert env.state_hash() == single.state_hash()


def test_a_chunk_stops_at_the_horizon(make: Make) -> None:
    env = make(chunk=4, horizon=6)
    env.reset(seed=1)
    steps = [env.step(waves(4)) for _ in range(2)]
    assert [(step[3], step[4]["executed"]) for step in steps] == [(False, 4), (True, 2)]
    assert env.get_wrapper_attr("_max_episode_steps") == 6
    assert env.metadata["render_fps"] * 4 == env.unwrapped.metadata["render_fps"] == 30


@pytest.mark.parametrize("mode", ["joint", "cartesian", "cartesian_relative"])
def test_a_bad_action_anywhere_in_a_chunk_moves_nothing(make: Make, mode: str) -> None:
    env = make(action_mode=mode, chunk=3, binary_gripper=True)
    env.reset(seed=0)
    before, chunk = env.state_hash(), np.ones(env.action_space.shape)
    bad = [("nan", chunk.copy()), ("shape", chunk[:2])]
    bad[0][1][2, 4] = np.nan
    if mode == "cartesian":
        bad.append(("quaternion", np.vstack([chunk[:2], np.zeros(16)])))
    for words, action in bad:
        with pytest.raises(ActionError, match=words):
            env.step(action)
    assert env.state_hash() == before
