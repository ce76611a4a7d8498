"""Other grippers and mounts, through their descriptions alone; one of them is a test's own."""

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import duobench
from duobench.core.errors import DataError, UnknownNameError
from duobench.core.types import SIDES, DuoCommand, Side
from duobench.data import (
    ExportOptions,
    ImageSource,
    export_lerobot,
    find_problems,
    summarize,
)
from duobench.data.card import write_data_card
from duobench.data.lerobot.actions import labels_of
from duobench.data.lerobot.options import ActionSource
from duobench.envs.config import EnvConfig
from duobench.envs.sim_env import sim_of
from duobench.evaluation.replay import replay
from duobench.policy import lerobot_checkpoint
from duobench.policy.training.training import plan_all
from duobench.real.catalog import load_driver
from duobench.real.clock import VirtualClock
from duobench.real.guard import Guard
from duobench.real.opening import open_rig, rehearsal_rig
from duobench.results.records import Condition
from duobench.results.suite import SuiteChoice, deviations
from duobench.tasks.experts.expert import Expert, find_script
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.cameras import describe_cameras
from duobench.world.robot.frames import ROBOT, Robot, robot_with
from duobench.world.robot.joints import JOINT_RANGES
from duobench.world.sim.simulation import Simulation
from tests.data.tools import data_of, only, recorder

PINCERS = "tests.world.robot.third_gripper:PINCERS"
ROBOTS = [robot_with("franka_hand"), robot_with(PINCERS), robot_with("robotiq_2f85", "wide")]
ids = pytest.mark.parametrize("robot", ROBOTS, ids=["franka hand", "pincers", "wide mount"])


@ids
def test_poses_of_numpy_are_those_of_the_engine(robot: Robot) -> None:
    sim, rng = Simulation(robot=robot), np.random.default_rng(0)
    for _ in range(20):
        joints = rng.uniform(*JOINT_RANGES.T, (2, 7))
        sim.duo.set_configuration(DuoCommand(joints=joints, openings=np.ones(2)))
        sim.forward()
        np.testing.assert_allclose(
            robot.tcp_poses(joints), sim.duo.read().tcp_poses, rtol=0, atol=1e-9
        )


def test_home_has_the_tools_of_every_gripper_on_one_axis() -> None:
    usual = ROBOT.tcp_poses(ROBOT.home)
    for robot in ROBOTS[:2]:
        tools = robot.tcp_poses(robot.home)
        assert tools[:, 3:] == pytest.approx(usual[:, 3:], abs=1e-9)
        shorter = robot.gripper.tool_offset - ROBOT.gripper.tool_offset
        for side in SIDES:
            away = (
                ROBOT.tool_pose(side, ROBOT.home[side.index]).inverse().apply(tools[side.index, :3])
            )
            assert away == pytest.approx([0, 0, shorter], abs=1e-9)


def test_a_gripper_of_ones_own_lifts_the_cubes_by_the_expert() -> None:
    env = duobench.make("bin_sort", gripper=PINCERS, cameras=False)
    base = sim_of(env)
    expert = Expert(base.simulation, find_script("bin_sort"))
    observation, info = env.reset(seed=0)
    expert.reset("", 0)
    for _ in range(150):
        observation, _, _, _, info = env.step(expert.act(observation)[0])
        if info["stage"] >= 2:
            break
    assert info["stage"] >= 2, "both cubes held together, or one in its bowl"
    assert env.get_wrapper_attr("config").gripper == PINCERS


@ids
def test_the_guard_knows_the_robot(robot: Robot) -> None:
    guard = Guard(robot)
    assert guard.problem(robot.home) is None
    tool = robot.tool_pose(Side.LEFT, robot.home[0])
    goal = tool.moved(x=0.1, z=-0.02 - tool.translation[2])
    low, _ = Kinematics(robot).solve(robot.home, {Side.LEFT: goal}, max_steps=300)
    words = guard.problem(low)
    assert words is not None
    assert "finger of the left gripper" in words
    assert "the table" in words


@pytest.mark.slow
@pytest.mark.parametrize("gripper", ["franka_hand", PINCERS])
def test_a_rehearsal_closes_on_nothing_and_opens(gripper: str) -> None:
    clock = VirtualClock()
    with closing(open_rig(rehearsal_rig(gripper), clock)) as duo:
        assert duo.world is not None
        driver = load_driver("grippers", duo.robot.gripper.driver)
        assert all(isinstance(each, driver.imitation) for each in duo.world.grippers.values())
        duo.start()
        duo.supervisor.confirm()
        duo.hands.activate()
        duo.home()
        assert duo.read().tcp_poses == pytest.approx(duo.robot.tcp_poses(duo.robot.home), abs=5e-3)
        for opening in (0.0, 0.6, 1.0):
            for _ in range(40):
                duo.command(DuoCommand(joints=duo.robot.home, openings=np.full(2, opening)))
            assert duo.read().openings == pytest.approx([opening] * 2, abs=0.02)


def test_targets_of_a_hand_that_stops_first_are_taken_on_a_grid() -> None:
    env = duobench.make("bin_sort", gripper="franka_hand", cameras=False)
    threads = duobench.make_vec("bin_sort", 2, gripper="franka_hand", threads=1)
    (start, _), (starts, _) = env.reset(seed=3), threads.reset(seed=[3, 4])
    np.testing.assert_array_equal(starts["agent_pos"][0], start["agent_pos"])
    home = robot_with("franka_hand").home_command.flat.astype(np.float32)
    for step in range(20):
        action = home.copy()
        action[[7, 15]] = step % 5 / 5
        seen, _, _, _, info = env.step(action)
        many, *_, told = threads.step(np.array([action, action]))
        np.testing.assert_array_equal(many["agent_pos"][0], seen["agent_pos"])
        if step % 6 == 0:
            taken = action[7]
        assert sim_of(env).backend.last_command.openings == pytest.approx([taken] * 2)
        assert info["sent"] == pytest.approx(action), "as on real arms: the hand itself waits"
        assert not info["clipped"].any(), "a target that waits is beyond no limit"
        assert not told["clipped"].any()
        np.testing.assert_array_equal(told["sent"][0], info["sent"])
    threads.close()


def test_an_unknown_gripper_is_named_with_those_that_there_are() -> None:
    with pytest.raises(UnknownNameError, match="franka_hand"):
        EnvConfig(gripper="franka_hnd")
    with pytest.raises(UnknownNameError, match="wide"):
        EnvConfig(mount="wid")
    assert EnvConfig(gripper="franka_hand", mount="wide").other_robot == "franka_hand wide"
    assert EnvConfig().other_robot == ""


def test_recordings_and_results_know_the_gripper(tmp_path: Path) -> None:
    env = recorder(tmp_path, gripper="franka_hand", action_mode="cartesian")
    env.reset(seed=2)
    start = env.base.backend.read().tcp_poses
    for _ in range(8):
        rows = np.column_stack([start, [0.0, 1.0]])
        env.step(rows.ravel())
    env.close()
    recording = only(tmp_path)
    assert recording.info.robot == robot_with("franka_hand")
    assert (
        recording.info.cameras["left_wrist"]
        == describe_cameras(recording.info.robot.gripper)["left_wrist"]
    )
    (found,) = replay("bin_sort", [recording])
    assert found.is_exact
    shown = ImageSource("bin_sort", cameras=())
    shown.show(recording, 8)
    seen = shown.simulation.duo.read()
    assert seen.openings[0] < seen.openings[1]
    assert seen.tcp_poses.ravel() == pytest.approx(recording.tcp_pose[8], abs=1e-6)
    targets, _ = labels_of(recording, "cartesian", ActionSource.SENT)
    assert targets.shape == (8, 20)
    usual, other = (
        Condition.of("expert", "sim", config)
        for config in (EnvConfig(), EnvConfig(gripper="franka_hand"))
    )
    assert usual.name == "expert.sim.none.default"
    assert other.name == "expert.sim.none.default.franka_hand"
    suite = SuiteChoice(suite="paper", gripper="franka_hand").make()
    assert "gripper franka_hand" in deviations(suite)


def test_what_is_made_of_recordings_knows_the_gripper(tmp_path: Path) -> None:
    data = data_of(tmp_path / "hand", 1, gripper="franka_hand", mount="wide")
    assert find_problems(data) == []
    assert summarize(data).domains == "1 simulated, with franka_hand wide"
    assert "with franka_hand wide" in write_data_card(data.path, "me/hand", "mit").read_text()
    out = tmp_path / "export"
    options = ExportOptions(cameras=(), object_state=True)
    export_lerobot(data, out, options)
    info = json.loads((out / "meta/info.json").read_text())
    assert info["robot_type"] == "franka_fr3_duo franka_hand wide"
    assert "v3.0, with franka_hand wide" in write_data_card(out, "me/hand", "mit").read_text()
    (training,) = plan_all("act", out, tmp_path / "act")
    training.checkpoint.mkdir(parents=True)
    training.name_features()
    assert lerobot_checkpoint.robot_of(training.checkpoint) == "franka_hand wide"
    usual = data_of(tmp_path / "usual", 1)
    assert summarize(usual).domains == "1 simulated"
    with pytest.raises(DataError, match="franka_hand wide, the paper's gripper and mount"):
        export_lerobot([data, usual], tmp_path / "both", options)


@pytest.mark.parametrize(
    ("kind", "robot"),
    [("franka_fr3_duo", ""), ("franka_fr3_duo franka_hand", "franka_hand"), ("so100", None)],
)
def test_data_sets_of_lerobot_say_what_a_checkpoint_learned_with(
    tmp_path: Path, kind: str, robot: str | None
) -> None:
    (tmp_path / "data/meta").mkdir(parents=True)
    (tmp_path / "data/meta/info.json").write_text(json.dumps({"robot_type": kind}))
    about = {"dataset": {"root": str(tmp_path / "data")}}
    (tmp_path / "train_config.json").write_text(json.dumps(about))
    assert lerobot_checkpoint.robot_of(tmp_path) == robot
