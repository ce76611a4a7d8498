"""What was written for simulation runs on real arms: policies, wrappers, sessions, recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.data import DataSet, Recorder
from duobench.envs import RelativeJointActions, base_of
from duobench.envs.protocol import make_env
from duobench.errors import BackendError, OptionError, UnknownNameError
from duobench.evaluation import rollout
from duobench.hardware.clock import VirtualClock
from duobench.hardware.env import RealEnv, make_real_env
from duobench.hardware.judge import HumanJudge
from duobench.hardware.opening import open_rig
from duobench.hardware.supervisor import State
from duobench.policy import PolicyMetadata
from duobench.rig_sessions.teleoperation import Teleoperation, TeleopState
from duobench.robot.frames import tcp_poses
from duobench.robot.joints import HOME_JOINTS
from duobench.teleop.hands import HandDevice
from duobench.types import CONTROL_HZ, SIDES, Side
from tests.hardware.rigs import arm, new_rig, wait
from tests.teleop.operator import hand, message, said

TASK = "bin_sort"


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


class Steps:
    """Keeps all steps of an episode."""

    def on_episode_start(self, _env: Any, _observation: Any, info: Any) -> None:
        self.info, self.steps = info, []

    def on_step(self, step: Any) -> None:
        self.steps.append(step)

    def on_episode_end(self, error: BaseException | None) -> None:
        self.error = error


def confirmed(task: str = TASK, **options: Any) -> tuple[Any, Any]:
    duo = new_rig()
    env = make_real_env(duo, task, **options)
    duo.supervisor.confirm()
    return duo, env


def test_spaces_are_those_of_the_simulation() -> None:
    for options in ({}, {"action_mode": "joint_relative", "chunk": 3, "binary_gripper": True}):
        simulated = make_env(TASK, **options)
        env = make_real_env(new_rig(), TASK, **options)
        assert env.action_space == simulated.action_space
        assert env.observation_space == simulated.observation_space
        env.close()
        simulated.close()


def test_a_policy_for_the_simulation_runs_unchanged() -> None:
    seen = []
    for is_real in (False, True):
        options: dict[str, Any] = {"image_size": (48, 64), "horizon": 30}
        env = confirmed(**options)[1] if is_real else make_env(TASK, **options)
        watcher = Steps()
        rollout(env, Wave(), seed=3, watchers=[watcher])
        assert watcher.error is None
        assert len(watcher.steps) == 30
        assert watcher.info["instruction"]
        seen.append(watcher.steps)
        env.close()
    for simulated, real in zip(*seen, strict=True):
        assert simulated.action == pytest.approx(real.action, abs=5e-3)
        there = real.observation["agent_pos"].reshape(2, 8)[:, :7]
        assert there == pytest.approx(real.info["sent"].reshape(2, 8)[:, :7], abs=0.03)


def test_info_says_what_was_sent_how_late_and_how_old_images_are() -> None:
    duo, env = confirmed(cameras=("head",))
    observation, info = env.reset(seed=5)
    assert (info["seed"], info["split"]) == (5, "eval")
    *_, info = env.step(observation["agent_pos"])
    assert info["late_s"] == 0.0
    assert info["image_ages"].keys() == set(duo.cameras)
    assert 0.0 <= max(info["image_ages"].values()) <= 1 / 30
    assert "truncation_reason" not in info
    wait(duo, 0.35)
    *_, info = env.step(observation["agent_pos"])
    assert info["late_s"] == pytest.approx(0.35 - 1 / 30)
    env.close()


def test_control_steps_keep_to_a_fixed_grid() -> None:
    duo, env = confirmed(cameras=False)
    action = env.reset(seed=0)[0]["agent_pos"]
    env.step(action)
    start = duo.clock.now()
    for late in (0.01, 0.02, 0.0, 0.04, 0.0):
        wait(duo, late)
        env.step(action)
    ticks = (duo.clock.now() - start) * CONTROL_HZ
    assert ticks == pytest.approx(6)  # one tick was missed, and no step made up for it
    env.close()


def test_tool_poses_are_those_of_our_own_kinematics() -> None:
    duo, env = confirmed(cameras=False)
    observation, _ = env.reset(seed=0)
    poses = tcp_poses(duo.read().joints)
    assert observation["tcp_pose"] == pytest.approx(poses.ravel(), abs=1e-6)
    env.close()


def test_the_rigs_narrower_limits_are_met_and_said() -> None:
    _, env = confirmed(cameras=False)
    action = env.reset(seed=0)[0]["agent_pos"].astype(float)
    action[0] += 0.08  # within the joint's own limit, beyond half of it
    *_, info = env.step(action)
    assert info["clipped"].nonzero()[0].tolist() == [0]
    assert info["sent"][0] < action[0] - 0.03
    env.close()


def test_a_declared_stage_counts_from_the_next_step_on() -> None:
    _, env = confirmed(cameras=False)
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
    env.close()


def test_a_judge_keeps_the_highest_stage_and_refuses_what_is_none() -> None:
    judge = HumanJudge(3)
    judge.declare(2)
    judge.declare(1)
    assert judge.labels.stage == 2
    noted = []
    for wrong in (0, 4):
        with pytest.raises(OptionError, match="1 to 3"):
            judge.declare(wrong, note=noted.append)
    judge.declare(None)
    assert judge.labels.stage == 2
    judge.declare(None)
    with pytest.raises(OptionError, match="no press"):
        judge.declare(None, note=noted.append)
    assert noted == []
    assert judge.declare(3, note=noted.append) in noted
    assert judge.stage == 0
    judge.judge()
    assert (judge.stage, judge.final_holds) == (3, True)
    state = judge.get_state()
    other = HumanJudge(3)
    other.set_state(state)
    assert other.stage == 3


def test_a_layout_is_what_was_asked_for_and_decides_the_instruction() -> None:
    simulated = make_env("pour_marbles", cameras=False)
    _, asked = simulated.reset(seed=4)
    prepared = []
    _, env = confirmed("pour_marbles", cameras=False, prepare=prepared.append)
    _, info = env.reset(seed=4, options={"layout": asked["layout"]})
    assert info["layout"] == asked["layout"]
    assert info["instruction"] == asked["instruction"]
    assert info["stage_to_subinstructions"] == asked["stage_to_subinstructions"]
    assert prepared[0]["layout"] == asked["layout"]
    assert env.reset(options={"instruction": "Dance."})[1]["instruction"] == "Dance."
    env.close()
    simulated.close()


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"object_state": True}, OptionError),
        ({"render_mode": "rgb_array"}, OptionError),
        ({"cameras": "left"}, UnknownNameError),
        ({"colour": 1}, UnknownNameError),
    ],
)
def test_what_only_a_simulation_has_is_refused(options: dict[str, Any], error: type) -> None:
    with pytest.raises(error):
        make_real_env(new_rig(), TASK, **options)


def test_a_reset_waits_for_the_operator_where_it_is_told_to() -> None:
    duo = new_rig()
    env = make_real_env(duo, TASK, cameras=False)
    with pytest.raises(BackendError, match="before the operator has confirmed"):
        env.reset()
    base_of(env).prepare = lambda _options: duo.supervisor.confirm()  # type: ignore[attr-defined]
    env.reset()
    assert isinstance(base_of(env), RealEnv)
    assert duo.supervisor.state is State.READY
    env.close()
    assert duo.supervisor.state is State.OFF


def test_an_episode_that_a_person_holds_ends_without_a_fault() -> None:
    duo, env = confirmed(cameras=False)
    action = env.reset(seed=0)[0]["agent_pos"]
    duo.hold("The space bar.")
    *_, truncated, info = env.step(action)
    assert truncated
    assert info["truncation_reason"] == "The space bar."
    assert "fault_kind" not in info
    env.close()


def test_relative_actions_start_from_what_was_really_sent() -> None:
    duo, env = confirmed(cameras=False, action_mode="joint_relative")
    assert isinstance(env.env if not isinstance(env, RelativeJointActions) else env, object)
    env.reset(seed=0)
    action = np.zeros(16)
    action[0], action[[7, 15]] = 0.01, 1.0
    for _ in range(10):
        env.step(action)
    moved = duo.last_command.joints[0, 0] - HOME_JOINTS[0, 0]
    assert moved == pytest.approx(0.1, abs=1e-6)
    env.close()


def test_a_session_leads_records_and_keeps_an_episode(tmp_path: Path) -> None:
    duo, env = confirmed(cameras=False, action_mode="cartesian", horizon=300)
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
    heights = duo.read().tcp_poses[:, 2] - tcp_poses(HOME_JOINTS)[:, 2]
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


def test_a_rig_can_be_opened_by_its_file(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    duo = open_rig("simulated", VirtualClock())
    duo.rig.write(path)
    again = open_rig(path, VirtualClock())
    assert again.rig == duo.rig
    assert again.rig.hash == duo.rig.hash


def test_two_episodes_on_a_virtual_clock_are_the_same() -> None:
    def play() -> np.ndarray:
        duo, env = confirmed(cameras=False)
        arm(duo, Side.LEFT).put(HOME_JOINTS[0] + 0.1)
        start = env.reset(seed=0)[0]["agent_pos"]
        found = [env.step(start + 0.01 * number)[0]["agent_pos"] for number in range(20)]
        env.close()
        return np.array(found)

    assert np.array_equal(play(), play())
