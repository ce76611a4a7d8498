"""Parts of LeRobot lead our arms by hands on the page, and our simulated robot follows."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from lerobot.common.control_utils import teleop_smooth_move_to, teleop_supports_feedback
from lerobot.envs import HILSerlRobotEnvConfig
from lerobot.processor import (
    AddTeleopActionAsComplimentaryDataStep,
    AddTeleopEventsAsInfoStep,
    DataProcessorPipeline,
    Torch2NumpyActionProcessorStep,
    TransitionKey,
    VanillaObservationProcessorStep,
    create_transition,
    identity_transition,
)
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot.teleoperators import TeleoperatorConfig, make_teleoperator_from_config
from lerobot.teleoperators.utils import TeleopEvents
from lerobot.utils.errors import DeviceNotConnectedError
from lerobot.utils.import_utils import register_third_party_plugins

import duobench
from duobench.core.errors import LeaderError, OptionError, UnknownNameError
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.spatial import SE3
from duobench.core.types import ARM_JOINTS, DuoCommand
from duobench.envs.spaces import JOINT_NAMES
from duobench.teleop.leaders.lerobot_source import LeRobotSource
from duobench.teleop.teleoperation import TeleopState
from duobench.world.robot.frames import ROBOT, robot_with
from tests.docs.markdown import page_of, table
from tests.teleop.operator import Operator, hand, message
from tests.web.pages import Page, get, open_page, unpack_frame

PAGE = page_of("lerobot_teleoperation")
OF_LEROBOT = ("id", "calibration_dir")
TASK = "carry_pot"
OPEN_HOME = ROBOT.home_command
KEYS = [f"{name}.pos" for name in JOINT_NAMES]


@pytest.fixture
def teleoperator(tmp_path: Path) -> Iterator[Any]:
    register_third_party_plugins()
    kind = TeleoperatorConfig.get_choice_class("duobench")
    config = kind(calibration_dir=tmp_path, lockstep=True)
    made = make_teleoperator_from_config(config)
    made.connect()
    yield made
    made.disconnect()
    with pytest.raises(DeviceNotConnectedError):
        made.get_action()


@pytest.fixture
def page(teleoperator: Any) -> Iterator[Page]:
    with open_page(teleoperator.url) as page:
        page.drive()
        yield page
        page.connection.socket.shutdown(socket.SHUT_RDWR)  # unread frames would delay a farewell


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Any]:
    kind = RobotConfig.get_choice_class("duobench")
    config = kind(calibration_dir=tmp_path, task=TASK, views=(), real_time=False)
    made = make_robot_from_config(config)
    made.connect()
    yield made
    made.disconnect()


@dataclass
class Place:
    """What the scripted operator sees of a session."""

    teleoperator: Any
    env: Any

    @property
    def state(self) -> TeleopState:
        return TeleopState.RECORDING if self.teleoperator.is_led else TeleopState.WAITING


def lead(page: Page, teleoperator: Any, number: int, pose: SE3, **more: Any) -> np.ndarray:
    """What an action is after both hands were sent."""
    both = hand(pose, **more)
    page.connection.send(message(number, both, both).decode())
    action = teleoperator.get_action()
    assert list(action) == KEYS
    return np.array(list(action.values()))


def begin(page: Page, teleoperator: Any) -> int:
    """Open both hands and lead the tools 3 cm up; the number of the last message."""
    lead(page, teleoperator, 1, SE3.at())
    for number in range(2, 30):
        height = min(0.03, 0.003 * (number - 2))
        lead(page, teleoperator, number, SE3.at(0.0, 0.0, height), squeeze=1.0)
    assert teleoperator.is_led
    return 29


def test_hands_on_the_page_carry_the_pot(page: Page, teleoperator: Any, robot: Any) -> None:
    """The environment takes the numbers as joint targets; the robot is that environment."""
    env = duobench.make(TASK, cameras=(), split=TRAIN)
    env.reset(seed=episode_seed(TASK, 0, TRAIN))
    operator = Operator(Place(teleoperator, robot.env))  # type: ignore[arg-type]
    is_solved, steps = False, 0
    while not is_solved:
        page.connection.send(operator.next_message().decode())
        observation = robot.get_observation()
        action = teleoperator.get_action()
        sent = robot.send_action(action)
        np.testing.assert_allclose(list(sent.values()), list(action.values()), atol=1e-6)
        seen, _, is_solved, truncated, info = env.step([action[key] for key in KEYS])
        assert not truncated, robot.progress
        steps += 1
        assert observation.keys() == robot.observation_features.keys()
    assert info["stage"] == info["max_stage"] == robot.progress["stage"]
    np.testing.assert_array_equal(list(robot.get_observation().values()), seen["agent_pos"])
    status = page.hear_of("status", success=True)
    assert (status["task"], status["clutch"]) == (TASK, {"left": True, "right": True})
    page.say(kind="keep")
    while robot.progress["count"] == 0:
        robot.send_action(teleoperator.get_action())
        robot.get_observation()
    assert not teleoperator.is_led
    np.testing.assert_array_equal(list(teleoperator.get_action().values()), OPEN_HOME.flat)
    env.close()


def test_the_page_shows_arms_alone_where_they_are_led(page: Page, teleoperator: Any) -> None:
    assert teleoperator.is_calibrated
    with open_page(teleoperator.url) as viewer:
        assert get(teleoperator.url, viewer.hear_of("scene")["url"])[0] == HTTPStatus.OK
    lead(page, teleoperator, 1, SE3.at())
    before = page.hear_of("status", state="waiting")
    assert "Lead a tool" in before["note"]
    for number in range(2, 60):
        height = min(0.03, 0.003 * (number - 2))
        lead(page, teleoperator, number, SE3.at(0.0, 0.0, height), squeeze=1.0, trigger=1.0)
    after = page.hear_of("status", state="recording")
    while after["tools"]["left"][2] < before["tools"]["left"][2] + 0.02:
        after = page.hear_of("status")
    poses = unpack_frame(page.frame())[0]
    assert poses.shape[0] > 2 * ARM_JOINTS


def test_hands_of_a_driver_who_is_gone_let_go(teleoperator: Any) -> None:
    with open_page(teleoperator.url) as page:
        page.drive()
        begin(page, teleoperator)
        events = teleoperator.get_teleop_events()
        assert events[TeleopEvents.IS_INTERVENTION]
        page.connection.socket.shutdown(socket.SHUT_RDWR)
    for _ in range(10):
        teleoperator.get_action()
    assert not teleoperator.get_teleop_events()[TeleopEvents.IS_INTERVENTION]


def test_keep_and_discard_are_events_of_lerobots_steps(page: Page, teleoperator: Any) -> None:
    number = begin(page, teleoperator)
    steps = (
        AddTeleopActionAsComplimentaryDataStep(teleoperator),
        AddTeleopEventsAsInfoStep(teleoperator),
    )
    names = (TeleopEvents.SUCCESS, TeleopEvents.FAILURE, TeleopEvents.RERECORD_EPISODE)
    told = {}
    for press in (None, "keep", "discard"):
        number += 1
        buttons = {} if press is None else {press: True}
        both = hand(SE3.at(0.0, 0.0, 0.03), squeeze=1.0, buttons=buttons)
        page.connection.send(message(number, both, both).decode())
        transition = create_transition(info={}, complementary_data={})
        for step in steps:
            transition = step(transition)
        assert list(transition[TransitionKey.COMPLEMENTARY_DATA]["teleop_action"]) == KEYS
        info = transition[TransitionKey.INFO]
        assert info[TeleopEvents.TERMINATE_EPISODE] is (press is not None)
        assert info[TeleopEvents.IS_INTERVENTION] is (press is None)
        told[press] = [info[name] for name in names]
    assert told == {None: [False] * 3, "keep": [True, False, False], "discard": [False, True, True]}
    np.testing.assert_array_equal(list(teleoperator.get_action().values()), OPEN_HOME.flat)


def test_hands_lead_another_gripper_as_the_robot_has_it(tmp_path: Path) -> None:
    register_third_party_plugins()
    both = {"calibration_dir": tmp_path, "gripper": "franka_hand", "mount": "wide"}
    led = make_teleoperator_from_config(TeleoperatorConfig.get_choice_class("duobench")(**both))
    led.connect()
    home = robot_with("franka_hand", "wide").home_command.flat
    np.testing.assert_array_equal(list(led.get_action().values()), home)
    kind = RobotConfig.get_choice_class("duobench")
    robot = make_robot_from_config(kind(**both, task=TASK, views=()))
    assert robot.robot_type == robot.name == "franka_fr3_duo franka_hand wide"
    robot.connect()
    assert robot.env.simulation.robot == robot_with("franka_hand", "wide")
    np.testing.assert_allclose(list(robot.get_observation().values()), home, atol=0.03)
    robot.disconnect()
    other = make_robot_from_config(kind(calibration_dir=tmp_path, task=TASK, views=()))
    assert other.name == "franka_fr3_duo"
    with pytest.raises(OptionError, match=r"a Franka Hand on mount wide.* give both the same"):
        other.connect()
    other.disconnect()
    led.disconnect()


def test_lerobot_brings_the_arms_to_where_a_robot_is(page: Page, teleoperator: Any) -> None:
    begin(page, teleoperator)
    assert teleop_supports_feedback(teleoperator)
    held = DuoCommand(joints=OPEN_HOME.joints + 0.1, openings=np.array([0.0, 1.0])).flat
    teleoperator.config.lockstep = False  # nobody sends hands meanwhile
    teleop_smooth_move_to(teleoperator, dict(zip(KEYS, held, strict=True)), duration_s=0.1)
    np.testing.assert_allclose(list(teleoperator.get_action().values()), held)
    assert not teleoperator.is_led


def test_feedback_is_felt_and_checked(page: Page, teleoperator: Any) -> None:
    teleoperator.send_feedback({"left_pulse": 0.5, "right_pulse": 7})
    pulses = [page.hear_of("pulse") for _ in range(2)]
    assert {(pulse["side"], pulse["strength"]) for pulse in pulses} == {("left", 0.5), ("right", 1)}
    with pytest.raises(UnknownNameError, match="left_pulse"):
        teleoperator.send_feedback({"left_puls": 0.5})
    with pytest.raises(LeaderError, match="1 of 16"):
        teleoperator.send_feedback({KEYS[0]: 0.5})
    with pytest.raises(LeaderError, match="finite"):
        teleoperator.send_feedback({"left_pulse": float("nan")})


def test_only_who_drives_leads_and_says_no_instruction(page: Page, teleoperator: Any) -> None:
    with open_page(teleoperator.url) as other:
        other.connection.send(message(1, None, None).decode())
        assert "take over" in other.hear_of("refused")["reason"]
    page.say(kind="instruction", text="Lift the pot.")
    assert "instruction" in page.hear_of("refused")["reason"]


def test_our_own_sessions_find_it_as_leader_arms(tmp_path: Path) -> None:
    source = LeRobotSource.make("duobench", calibration_dir=tmp_path)
    source.connect()
    np.testing.assert_array_equal(source.read(), OPEN_HOME.flat)
    source.close()


class Messenger(gym.Wrapper):
    """An environment that has the operator send hands for every step."""

    def __init__(self, page: Page, teleoperator: Any) -> None:
        super().__init__(duobench.make(TASK, cameras=(), split=TRAIN))
        self.infos: list[Any] = []
        self._page = page
        self._operator = Operator(Place(teleoperator, self.env))  # type: ignore[arg-type]

    def reset(self, **options: Any) -> Any:
        start = self.env.reset(**options)
        self._send()
        return start

    def step(self, action: Any) -> Any:
        transition = self.env.step(action)
        self.infos.append(transition[-1])
        self._send()
        return transition

    def _send(self) -> None:
        self._page.connection.send(self._operator.next_message().decode())


def test_lerobots_control_loop_plays_our_environment(page: Page, teleoperator: Any) -> None:
    from lerobot.rl.gym_manipulator import DatasetConfig, GymManipulatorConfig, control_loop

    from lerobot_env_duobench import LeadArms

    steps = [
        AddTeleopActionAsComplimentaryDataStep(teleoperator),
        AddTeleopEventsAsInfoStep(teleoperator),
        LeadArms(),
        Torch2NumpyActionProcessorStep(),
    ]
    seeing = [VanillaObservationProcessorStep()]
    whole = {"to_transition": identity_transition, "to_output": identity_transition}
    config = GymManipulatorConfig(
        env=HILSerlRobotEnvConfig(fps=100_000),
        dataset=DatasetConfig(repo_id="local/none", task=TASK, num_episodes_to_record=1),
    )
    env = Messenger(page, teleoperator)
    pipelines = [DataProcessorPipeline(steps=each, **whole) for each in (seeing, steps)]
    control_loop(env, *pipelines, teleoperator, config)
    assert [info["success"] for info in env.infos] == [False] * (len(env.infos) - 1) + [True]
    assert env.infos[-1]["stage"] == env.infos[-1]["max_stage"]
    env.close()


@pytest.mark.parametrize(
    ("registry", "word"), [(TeleoperatorConfig, "teleop"), (RobotConfig, "robot")]
)
def test_the_page_on_it_names_every_option(registry: Any, word: str) -> None:
    register_third_party_plugins()
    config = registry.get_choice_class("duobench")()
    own = {name: getattr(config, name) for name in vars(config) if name not in OF_LEROBOT}
    rows = table(PAGE, "option")
    said = dict.fromkeys(re.findall(rf"--{word}\.(\w+)", " ".join(row["option"] for row in rows)))
    assert said.keys() == own.keys()
    defaults = ", ".join(row["default"] for row in rows if f"--{word}." in row["option"])
    for value in own.values():
        shown = f"[{','.join(value)}]" if isinstance(value, tuple) else str(value)
        assert (shown.lower() if isinstance(value, bool) else shown) in defaults
