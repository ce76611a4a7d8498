"""What was written for simulation runs on real arms: policies, wrappers, sessions, recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import BackendError, OptionError, UnknownNameError
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.data import DataSet, Recorder
from duobench.envs import base_of
from duobench.envs.protocol import make_env
from duobench.evaluation import rollout
from duobench.policy import PolicyMetadata
from duobench.real.env import RealEnv, make_real_env
from duobench.real.judge import HumanJudge
from duobench.real.supervisor import State
from duobench.teleop.hands import HandDevice
from duobench.teleop.teleoperation import Teleoperation, TeleopState
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.rigs import Steps, arm, new_rig, refused, wait
from tests.teleop.operator import hand, message, said

SIDE = {"name": "side", "position": (0.5, 1.2, 0.5), "look_at": (0.5, 0.0, 0.0)}
TASK = "bin_sort"
Made = Callable[..., tuple[Any, Any]]


class Wave:
    """Moves every joint a little, in chunks of three, and looks at all images."""

    metadata = PolicyMetadata(name="wave", image_size=(48, 64))

    def reset(self, instruction: str, seed: int) -> None:
        assert instruction
        assert seed >= 0
        self.steps = 0

    def act(self, observation: dict[str, Any]) -> np.ndarray:
        assert {image.shape for image in observation["pixels"].values()} == {(48, 64, 3)}
        start = observation["agent_pos"] if self.steps == 0 else self.start
        self.start = start
        self.steps += 3
        times = (self.steps + np.arange(3)) / CONTROL_HZ
        return start + 0.1 * (1.0 - np.cos(times))[:, None] * np.ones(16)


@pytest.fixture
def made() -> Iterator[Made]:
    """Makes a rig that may move and its environment, which is closed after the test."""
    envs = []

    def make(task: str = TASK, *, cameras: Any = False, **options: Any) -> tuple[Any, Any]:
        duo = new_rig()
        envs.append(make_real_env(duo, task, cameras=cameras, **options))
        duo.supervisor.confirm()
        return duo, envs[-1]

    yield make
    for env in envs:
        env.close()


@pytest.mark.parametrize(
    "options", [{}, {"action_mode": "joint_relative", "chunk": 3, "binary_gripper": True}]
)
def test_spaces_are_those_of_the_simulation(made: Made, options: dict[str, Any]) -> None:
    simulated, (_, env) = make_env(TASK, **options), made(cameras=True, **options)
    assert env.action_space == simulated.action_space
    assert env.observation_space == simulated.observation_space
    simulated.close()


def test_a_policy_for_the_simulation_runs_unchanged(made: Made) -> None:
    options: dict[str, Any] = {"image_size": (48, 64), "horizon": 30, "cameras": True}
    seen = []
    for env in (make_env(TASK, **options), made(**options)[1]):
        watcher = Steps()
        rollout(env, Wave(), seed=3, watchers=[watcher])
        assert watcher.error is None
        assert len(watcher.steps) == 30
        assert watcher.info["instruction"]
        seen.append(watcher.steps)
    for simulated, real in zip(*seen, strict=True):
        assert simulated.action == pytest.approx(real.action, abs=5e-3)
        there = real.observation["agent_pos"].reshape(2, 8)[:, :7]
        assert there == pytest.approx(real.info["sent"].reshape(2, 8)[:, :7], abs=0.03)


def test_info_says_what_was_sent_how_late_and_how_old_images_are(made: Made) -> None:
    duo, env = made(cameras=("head",))
    observation, info = env.reset(seed=5)
    assert (info["seed"], info["split"]) == (5, "eval")
    *_, info = env.step(observation["agent_pos"])
    assert info["late_s"] == 0.0
    assert info["image_ages"].keys() == {"head"}, "the one that it sees"
    assert 0.0 <= max(info["image_ages"].values()) <= 1 / 30
    assert "truncation_reason" not in info
    wait(duo, 0.35)
    *_, info = env.step(observation["agent_pos"])
    assert info["late_s"] == pytest.approx(0.35 - 1 / 30)


def test_control_steps_keep_to_a_fixed_grid(made: Made) -> None:
    duo, env = made()
    observation, _ = env.reset(seed=0)
    poses = ROBOT.tcp_poses(duo.read().joints)
    assert observation["tcp_pose"] == pytest.approx(poses.ravel(), abs=1e-6)
    action = observation["agent_pos"]
    env.step(action)
    start = duo.clock.now()
    for late in (0.01, 0.02, 0.0, 0.04, 0.0):
        wait(duo, late)
        env.step(action)
    ticks = (duo.clock.now() - start) * CONTROL_HZ
    assert ticks == pytest.approx(6)  # one tick was missed, and no step made up for it


def test_the_rigs_narrower_limits_are_met_and_said(made: Made) -> None:
    _, env = made()
    action = env.reset(seed=0)[0]["agent_pos"].astype(float)
    action[0] += 0.08  # within the joint's own limit, beyond half of it
    *_, info = env.step(action)
    assert info["clipped"].nonzero()[0].tolist() == [0]
    assert info["sent"][0] < action[0] - 0.03


def test_a_declared_stage_counts_from_the_next_step_on(made: Made) -> None:
    _, env = made()
    judge = env.get_wrapper_attr("judge")
    action = env.reset(seed=0)[0]["agent_pos"]
    judge.declare(2)
    assert env.step(action)[-1]["stage"] == 2
    judge.declare(5)
    judge.declare(None)
    assert env.step(action)[-1]["stage"] == 2
    judge.declare(5)
    _, reward, terminated, _, info = env.step(action)
    assert (reward, terminated, info["success"], info["success_at_end"]) == (1.0, True, True, True)
    labels = [(label.stage, label.step) for label in judge.labels.all]
    assert labels == [(2, 0), (5, 1), (None, 1), (5, 2)]
    assert judge.labels.changes() == ((0, 2), (2, 5))
    env.reset(seed=1)
    assert (judge.stage, judge.labels.all) == (0, ())


def test_no_person_measures_how_near_a_stage_is(made: Made) -> None:
    with pytest.raises(OptionError, match="Only the simulation can measure"):
        made(reward="dense")


def test_the_reward_progress_takes_back_what_a_person_takes_back(made: Made) -> None:
    _, env = made(reward="progress")
    judge = env.get_wrapper_attr("judge")
    action = env.reset(seed=0)[0]["agent_pos"]
    paid = []
    for label in (2, None, 5):
        judge.declare(label)
        paid.append(env.step(action)[1])
    assert paid == [2 / 5, -2 / 5, 1.0]


def test_a_judge_keeps_the_highest_stage_and_refuses_what_is_none() -> None:
    judge, other, noted = HumanJudge(3), HumanJudge(3), []
    stages = []
    for label in (2, 1, None, None):
        judge.declare(label)
        stages.append(judge.labels.stage)
    assert stages == [2, 2, 2, 0]
    for wrong, words in ((0, "1 to 3"), (4, "1 to 3"), (None, "no press")):
        with pytest.raises(OptionError, match=words):
            judge.declare(wrong, note=noted.append)
    assert noted == []
    assert judge.declare(3, note=noted.append) in noted
    assert judge.stage == 0
    judge.judge()
    assert (judge.stage, judge.final_holds) == (3, True)
    other.set_state(judge.get_state())
    assert other.stage == 3


def test_a_layout_is_what_was_asked_for_and_decides_the_instruction(made: Made) -> None:
    simulated = make_env("pour_marbles", cameras=False)
    _, asked = simulated.reset(seed=4)
    simulated.close()
    prepared = []
    _, env = made("pour_marbles", prepare=prepared.append)
    _, info = env.reset(seed=4, options={"layout": asked["layout"]})
    for key in ("layout", "instruction", "stage_to_subinstructions"):
        assert info[key] == asked[key]
    assert prepared[0]["layout"] == asked["layout"]
    assert env.reset(options={"instruction": "Dance."})[1]["instruction"] == "Dance."
    for unknown in ("nonsense", "look"):  # which no person changes
        with pytest.raises(UnknownNameError, match=f"'{unknown}'. Known: instruction, layout"):
            env.reset(options={unknown: "dark"})


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"object_state": True}, OptionError),
        ({"render_mode": "rgb_array"}, OptionError),
        ({"cameras": "left"}, UnknownNameError),
        ({"cameras": SIDE}, BackendError),
        ({"segmentation": "left_wrist"}, BackendError),
        ({"colour": 1}, UnknownNameError),
    ],
)
def test_what_only_a_simulation_has_is_refused(options: dict[str, Any], error: type) -> None:
    with pytest.raises(error):
        make_real_env(new_rig(), TASK, **options)


def test_a_reset_waits_for_the_operator_where_it_is_told_to() -> None:
    duo = new_rig()
    env = make_real_env(duo, TASK, cameras=False)
    assert "before the operator has confirmed" in refused(env.reset)
    base_of(env).prepare = lambda _options: duo.supervisor.confirm()  # type: ignore[attr-defined]
    env.reset()
    assert isinstance(base_of(env), RealEnv)
    assert duo.supervisor.state is State.READY
    env.close()
    assert duo.supervisor.state is State.OFF


def test_an_episode_that_a_person_holds_ends_without_a_fault(made: Made) -> None:
    duo, env = made()
    action = env.reset(seed=0)[0]["agent_pos"]
    duo.hold("The space bar.")
    *_, truncated, info = env.step(action)
    assert truncated
    assert info["truncation_reason"] == "The space bar."
    assert "fault_kind" not in info


def test_relative_actions_start_from_what_was_really_sent(made: Made) -> None:
    duo, env = made(action_mode="joint_relative")
    env.reset(seed=0)
    action = np.zeros(16)
    action[0], action[[7, 15]] = 0.01, 1.0
    for _ in range(10):
        env.step(action)
    moved = duo.last_command.joints[0, 0] - HOME_JOINTS[0, 0]
    assert moved == pytest.approx(0.1, abs=1e-6)


def test_a_session_leads_records_and_keeps_an_episode(made: Made, tmp_path: Path) -> None:
    duo, env = made(action_mode="cartesian", horizon=300)
    device = HandDevice()
    session = Teleoperation(
        Recorder(env, tmp_path, is_reviewed=True, has_clutch=True), device, episodes=1
    )
    homes = {side: env.get_wrapper_attr("kinematics").forward(HOME_JOINTS)[side] for side in SIDES}
    turn = 0

    def send(squeeze: float, rise: float) -> None:
        nonlocal turn
        hands = [hand(homes[side].moved(0, 0, rise), squeeze=squeeze) for side in SIDES]
        session.receive(said(message(turn, *hands)), turn / CONTROL_HZ)
        session.advance(turn / CONTROL_HZ)
        turn += 1

    send(0.0, 0.0)
    send(1.0, 0.0)
    assert session.state is TeleopState.RECORDING
    for number in range(60):
        send(1.0, min(0.05, 0.001 * number))
    heights = duo.read().tcp_poses[:, 2] - ROBOT.tcp_poses(HOME_JOINTS)[:, 2]
    assert heights == pytest.approx([0.05, 0.05], abs=2e-3)
    env.get_wrapper_attr("judge").declare(5)
    send(1.0, 0.05)
    assert session.state is TeleopState.DECIDE
    session._keep()
    session.close()
    (recording,) = DataSet.open(tmp_path).recordings()
    assert recording.info.is_real
    assert recording.info.outcome is not None
    assert recording.info.outcome.success
    assert recording.stage[-1] == 5
    assert recording.clutch is not None
    assert recording.clutch.all()


def test_two_episodes_on_a_virtual_clock_are_the_same(made: Made) -> None:
    def play() -> np.ndarray:
        duo, env = made()
        arm(duo, Side.LEFT).put(HOME_JOINTS[0] + 0.1)
        start = env.reset(seed=0)[0]["agent_pos"]
        return np.array([env.step(start + 0.01 * k)[0]["agent_pos"] for k in range(20)])

    assert np.array_equal(play(), play())
