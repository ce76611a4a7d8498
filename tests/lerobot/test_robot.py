"""Real arms as a robot of LeRobot, on a rig that is computed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot.utils.errors import DeviceNotConnectedError
from lerobot.utils.import_utils import register_third_party_plugins

from duobench.core.errors import ActionError, BackendError, OptionError, UnknownNameError
from duobench.core.types import Side
from duobench.real.clock import VirtualClock
from duobench.real.opening import open_rig, rehearsal_rig
from duobench.world.robot.mounts import HOME_JOINTS
from lerobot_env_duobench import DuoBenchDuo, DuoBenchDuoConfig
from lerobot_env_duobench.config import KEYS
from tests.real.simulated import simulated_rig

CONFIG = DuoBenchDuoConfig(rig="rehearsal", ask=False, image_size=32)


@pytest.fixture
def robot() -> Iterator[DuoBenchDuo]:
    made = DuoBenchDuo(CONFIG, open_rig(simulated_rig(), VirtualClock()))
    made.connect()
    yield made
    if made.is_connected:
        made.disconnect()


def test_grippers_of_a_rehearsal_are_activated_without_a_question() -> None:
    rig = open_rig("rehearsal", VirtualClock())
    robot = DuoBenchDuo(CONFIG, rig)
    robot.connect()
    assert not rig.hands.inactive
    robot.disconnect()


def test_its_kind_names_the_gripper_of_the_rig() -> None:
    rig = open_rig(rehearsal_rig("franka_hand"), VirtualClock())
    assert DuoBenchDuo(CONFIG, rig).name == "franka_fr3_duo franka_hand"


def test_lerobot_finds_it_by_its_name() -> None:
    register_third_party_plugins()
    assert RobotConfig.get_choice_class("duobench_duo") is DuoBenchDuoConfig
    assert isinstance(make_robot_from_config(CONFIG), DuoBenchDuo)


def test_features_are_known_before_it_is_connected_and_kept_afterwards(robot: DuoBenchDuo) -> None:
    apart = DuoBenchDuo(CONFIG)
    assert apart.observation_features == robot.observation_features
    seen = robot.get_observation()
    assert set(seen) == set(robot.observation_features)
    assert seen["head"].shape == robot.observation_features["head"] == (32, 32, 3)
    assert set(robot.action_features) == set(KEYS)
    with pytest.raises(DeviceNotConnectedError):
        apart.get_observation()


def test_arms_go_where_they_are_sent_and_what_was_sent_is_said(robot: DuoBenchDuo) -> None:
    begun = robot.get_observation()
    numbers = np.array([begun[key] for key in KEYS]).reshape(2, 8)
    np.testing.assert_allclose(numbers[:, :7], HOME_JOINTS, atol=0.03)
    goal = {**begun, "left_joint_1.pos": begun["left_joint_1.pos"] + 0.2, "right_gripper.pos": 0.0}
    first = robot.send_action(goal)
    assert first["left_joint_1.pos"] < goal["left_joint_1.pos"]  # approached, never jumped to
    for _ in range(60):
        sent = robot.send_action(goal)
    assert sent["left_joint_1.pos"] == pytest.approx(goal["left_joint_1.pos"])
    now = robot.get_observation()
    assert now["left_joint_1.pos"] == pytest.approx(goal["left_joint_1.pos"], abs=0.01)
    assert now["right_gripper.pos"] < 0.05


def test_wrong_actions_move_nothing(robot: DuoBenchDuo) -> None:
    begun = robot.get_observation()
    action = {key: begun[key] for key in KEYS}
    with pytest.raises(ActionError, match=r"right_gripper\.pos is not there"):
        robot.send_action({key: action[key] for key in KEYS[:-1]})
    with pytest.raises(ActionError, match="finite"):
        robot.send_action({**action, "left_joint_3.pos": float("nan")})
    assert robot.get_observation()["left_joint_3.pos"] == action["left_joint_3.pos"]


@pytest.mark.parametrize("who", ["arm", "person"])
def test_what_holds_the_arms_ends_the_program(who: str) -> None:
    rig = open_rig(simulated_rig(), VirtualClock())
    robot = DuoBenchDuo(CONFIG, rig)
    robot.connect()
    action = {key: robot.get_observation()[key] for key in KEYS}
    robot.send_action(action)
    if who == "arm":
        rig.arms[Side.LEFT].fail("It touched something.")  # pyright: ignore[reportAttributeAccessIssue]
    else:
        rig.hold("A person presses the button.")
    with pytest.raises(BackendError, match="Both arms hold"):
        robot.send_action(action)
    with pytest.raises(BackendError, match="Both arms hold"):
        robot.get_observation()
    robot.disconnect()


def test_real_arms_move_only_after_somebody_confirmed() -> None:
    with pytest.raises(OptionError, match="Somebody has to confirm"):
        DuoBenchDuo(DuoBenchDuoConfig(rig="rig.json", ask=False))
    with pytest.raises(OptionError, match="rig is the file"):
        DuoBenchDuo(DuoBenchDuoConfig())
    with pytest.raises(UnknownNameError, match="heat"):
        DuoBenchDuo(DuoBenchDuoConfig(rig="rehearsal", ask=False, views=("heat",)))
    rig = open_rig(simulated_rig(), VirtualClock())
    robot = DuoBenchDuo(DuoBenchDuoConfig(rig="rehearsal"), rig)
    with pytest.raises(BackendError, match="Somebody has to confirm in a terminal"):
        robot.connect()
    assert not robot.is_connected
    assert str(rig.supervisor.state) == "off"
