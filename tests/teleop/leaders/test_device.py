from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import LeaderError
from duobench.core.types import CONTROL_HZ, DuoCommand
from duobench.data import Actor, ActorKind, DataSet
from duobench.envs.sim_env import sim_of
from duobench.envs.spaces import JOINT_NAMES
from duobench.tasks.experts.expert import Expert, find_script
from duobench.teleop.leaders.device import LeaderDevice
from duobench.teleop.leaders.lerobot_source import LeRobotSource
from duobench.teleop.messages import Keep
from duobench.teleop.teleoperation import Teleoperation, TeleopState, make_recorder
from duobench.world.robot.mounts import HOME_JOINTS

HOME = DuoCommand(joints=np.array(HOME_JOINTS), openings=np.ones(2)).flat


class Leaders:
    """Two arms with the methods of a teleoperator of LeRobot."""

    name = "numbers"

    def __init__(self, names: tuple[str, ...] = JOINT_NAMES, ending: str = ".pos") -> None:
        self.names, self.ending = names, ending
        self.now = HOME.copy()
        self.is_connected = False
        self.fault: Exception | None = None

    @property
    def action_features(self) -> dict[str, type]:
        return {f"{name}{self.ending}": float for name in reversed(self.names)}

    def connect(self, calibrate: bool = True) -> None:
        if self.fault is not None:
            raise self.fault
        self.is_connected = calibrate

    def get_action(self) -> Mapping[str, Any]:
        if self.fault is not None:
            raise self.fault
        return {f"{n}{self.ending}": v for n, v in zip(JOINT_NAMES, self.now, strict=True)}

    def disconnect(self) -> None:
        self.is_connected = False


def session_of(leaders: Leaders, data: Path | None = None, task: str = "bin_sort") -> Teleoperation:
    source = LeRobotSource(leaders)
    source.connect()
    actor = Actor(kind=ActorKind.SCRIPTED_OPERATOR, device=source.device)
    device = LeaderDevice(source)
    return Teleoperation(make_recorder(task, data, actor, action_mode="joint"), device, episodes=1)


def test_leaders_that_follow_an_expert_solve_a_task(tmp_path: Path) -> None:
    leaders = Leaders()
    session = session_of(leaders, tmp_path)
    env = sim_of(session.env)
    expert = Expert(env.simulation, find_script("bin_sort"))
    expert.reset("", 0)
    session.advance(0.0)
    assert session.note == "Move a leader to begin."
    turn = 0
    while session.state is not TeleopState.OVER:
        leaders.now = np.asarray(expert.act(None)[0], dtype=np.float64)
        turn += 1
        session.advance(turn / CONTROL_HZ)
        if session.state is TeleopState.DECIDE:
            session.receive(Keep(), turn / CONTROL_HZ)
    session.close()
    (recording,) = DataSet.open(tmp_path).recordings()
    assert recording.info.outcome is not None
    assert recording.info.outcome.success
    assert recording.info.action_mode == "joint"
    assert recording.info.actor.device == "lerobot numbers"
    assert recording.clutch.all()


def test_an_episode_waits_until_the_leaders_are_where_the_robot_is() -> None:
    leaders = Leaders()
    session = session_of(leaders)
    leaders.now[3] += 0.6
    session.advance(0.0)
    assert "left_joint_4 is 0.60 rad away" in session.note
    leaders.now[3] -= 0.4
    leaders.now[15] = 0.2
    session.advance(0.1)
    assert session.note == "Open both grippers."
    leaders.now[15] = 1.0
    session.advance(0.2)
    assert session.note == "Move a leader to begin."
    leaders.now[10] += 0.06
    assert session.advance(0.3)
    session.close()


def test_what_is_left_between_leader_and_robot_is_closed_without_a_jump() -> None:
    leaders = Leaders()
    session = session_of(leaders)
    backend = session.env.base.backend
    leaders.now[3] += 0.3
    session.advance(0.0)
    leaders.now[10] += 0.06
    before = backend.last_command.flat
    for number in range(31):
        session.advance(number / CONTROL_HZ)
        now = backend.last_command.flat
        assert np.abs(now - before).max() < 0.02
        before = now
    np.testing.assert_allclose(before, leaders.now, atol=1e-9)
    session.close()


def test_leaders_that_fall_silent_leave_the_robot_where_it_is() -> None:
    leaders = Leaders()
    session = session_of(leaders)
    backend = session.env.base.backend
    session.advance(0.0)
    leaders.now[10] += 0.06
    for number in range(40):
        session.advance(number / CONTROL_HZ)
    held = backend.last_command.flat
    leaders.fault = ConnectionError("the cable was pulled")
    for number in range(5):
        assert session.advance(2.0 + number / CONTROL_HZ)
    np.testing.assert_array_equal(backend.last_command.flat, held)
    assert session.status()["clutch"] == {"left": False, "right": False}
    assert session.status()["lost"] == 5
    leaders.fault = None
    leaders.now[10] += 0.3
    session.advance(3.0)
    assert session.status()["clutch"] == {"left": True, "right": True}
    assert np.abs(backend.last_command.flat - held).max() < 0.02
    session.close()


def test_leaders_that_tremble_lead_nothing_and_slow_ones_do() -> None:
    leaders, draw = Leaders(), np.random.default_rng(0)
    session = session_of(leaders)
    backend = session.env.base.backend
    leaders.now[10] += 0.06
    session.advance(0.0)
    leaders.now[10] += 0.06
    for _ in range(100):
        session.advance(0.0)
    rest, step = leaders.now.copy(), session.status()["step"]
    for _ in range(300):
        leaders.now = rest + draw.normal(0.0, 4e-4, size=16)
        assert not session.advance(0.0)
    assert (session.status()["pace"], session.status()["step"]) == ("standing", step)
    made, before = 0, backend.last_command.flat
    for number in range(300):
        leaders.now = rest.copy()
        leaders.now[0] += 4e-4 * number
        made += session.advance(0.0)
        now = backend.last_command.flat
        assert np.abs(now - before).max() < 0.01
        before = now
    assert made > 280
    np.testing.assert_allclose(backend.last_command.flat, leaders.now, atol=1e-9)
    session.close()


def test_teleoperators_with_other_numbers_are_refused() -> None:
    assert LeRobotSource(Leaders(ending="")).read() is not None
    with pytest.raises(LeaderError, match=r"left_joint_1\.pos to right_gripper\.pos"):
        LeRobotSource(Leaders(JOINT_NAMES[:8]))
    with pytest.raises(LeaderError, match="seven joints"):
        LeRobotSource(Leaders((*JOINT_NAMES, "head")))
    broken = Leaders()
    source = LeRobotSource(broken)
    broken.fault = ConnectionError("no such port")
    with pytest.raises(LeaderError, match="lerobot numbers cannot be reached: no such port"):
        source.connect()
    broken.fault = None
    broken.now[0] = np.nan
    assert source.read() is None
