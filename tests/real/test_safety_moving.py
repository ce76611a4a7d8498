"""Safety rules 1 to 4: the operator's word, bounds, stalls and stops."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from duobench.core.errors import ActionError
from duobench.core.types import SIDES, DuoCommand, Side
from duobench.real import watchdog
from duobench.real.duo import FrankaDuo
from duobench.real.follower import HIGHEST, LOWEST
from duobench.real.rig import (
    FOLLOWER_HZ,
    MAX_ACCELERATION,
    MAX_SPEED_FRACTION,
    ArmConfig,
    GripperConfig,
)
from duobench.real.supervisor import State
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.joints import VELOCITY_LIMITS
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.rigs import (
    PERIOD,
    Log,
    arm,
    confirmed,
    home,
    is_tracking,
    joints,
    move_on,
    new_rig,
    put,
    ready_rig,
    refused,
    shifted,
    speeds,
    wait,
)
from tests.real.simulated import simulated_rig

GRIPPER = ROBOT.gripper

AWAY = np.array([0.2, -0.2, 0.3, 0.2, -0.3, 0.2, 0.4])


# --- 1: a hold, then a damped stop ----------------------------------------------------------------


def test_a_hold_brings_both_arms_to_rest_and_commands_move_nothing_until_home() -> None:
    duo = ready_rig()
    move_on(duo)
    assert np.abs(speeds(duo)[:, 0]).min() > 0.3
    duo.hold("The button on the page.")
    wait(duo, 0.3)
    assert np.abs(speeds(duo)).max() < 1e-3
    where = joints(duo)
    for _ in range(10):
        sent = duo.command(shifted(1.0))
        assert np.array_equal(sent.flat, duo.last_command.flat)
    assert joints(duo) == pytest.approx(where, abs=1e-3)
    told = duo.supervisor.state, duo.held, duo.fault
    assert told == (State.HOLDING, "The button on the page.", None)


def test_a_hold_leaves_the_fingers_where_they_are() -> None:
    duo = ready_rig()
    for _ in range(3):
        duo.command(DuoCommand(joints=HOME_JOINTS, openings=np.zeros(2)))
    duo.hold("The button on the page.")
    openings = [reading.opening for reading in duo.gripper_readings().values()]
    assert 0.5 < min(openings) < 0.95
    wait(duo, 0.5)
    assert [reading.opening for reading in duo.gripper_readings().values()] == openings


def test_after_a_hold_home_needs_the_operators_word_again() -> None:
    duo = ready_rig()
    duo.hold("The space bar.")
    assert "before the operator has confirmed" in refused(duo.home)
    home(duo)
    assert (duo.held, duo.supervisor.state) == (None, State.READY)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> float:
    """Let thirty seconds pass in three."""
    assert watchdog.STOP_AFTER_S == 30.0
    monkeypatch.setattr(watchdog, "STOP_AFTER_S", 3.0)
    return 3.0


def test_arms_that_are_held_stop_damped_after_a_while(soon: float) -> None:
    duo = ready_rig()
    duo.command(shifted(0.01))
    duo.hold("The connection to the page is lost.")
    wait(duo, soon - 1.0)
    assert is_tracking(duo) == [True, True]
    wait(duo, 2.0)
    assert is_tracking(duo) == [False, False]
    assert duo.held == "The connection to the page is lost."


def test_arms_that_wait_at_home_are_not_engaged_for_long_and_are_again_when_led(
    soon: float,
) -> None:
    duo = ready_rig()
    wait(duo, soon - 0.5)
    assert is_tracking(duo) == [True, True]
    wait(duo, 1.0)
    assert is_tracking(duo) == [False, False]
    assert (duo.held, duo.supervisor.state) == (None, State.READY)
    for _ in range(30):
        duo.command(shifted(0.1))
    assert is_tracking(duo) == [True, True]
    assert joints(duo)[:, 0] == pytest.approx(HOME_JOINTS[:, 0] + 0.1, abs=0.01)
    duo.stop()
    home(duo)
    wait(duo, soon + 1.0)
    duo.home()
    assert (is_tracking(duo), duo.supervisor.state) == ([True, True], State.READY)


def test_a_way_home_may_take_longer_than_arms_wait_for_commands(soon: float) -> None:
    duo = new_rig()
    put(duo, HOME_JOINTS + 4.0 * AWAY)
    start = duo.clock.now()
    confirmed(duo).home()
    assert duo.clock.now() - start > soon + 1.0
    assert duo.supervisor.state is State.READY


def test_arms_on_a_way_home_that_nobody_leads_any_more_stop(soon: float) -> None:
    duo = ready_rig()
    duo.supervisor.begin(State.HOMING)
    wait(duo, soon + 1.0)
    assert (is_tracking(duo), duo.supervisor.state) == ([False, False], State.HOLDING)


def test_tools_are_led_no_faster_than_they_may_be_and_arms_together() -> None:
    duo = ready_rig(simulated_rig([Side.RIGHT], tool_speed=0.2))
    log, target, before = Log(duo, Side.RIGHT), shifted(0.4), duo.last_command
    shares = []
    while not np.array_equal(duo.last_command.joints, target.joints):
        sent = duo.command(target).joints
        gone = (sent - before.joints)[:, 0] / 0.4
        assert gone[0] == pytest.approx(gone[1], abs=1e-9)  # hands that hold one thing
        shares.append(gone[0])
    assert len(shares) > 20
    for _ in range(15):
        duo.command(target)
    assert duo.read().joints == pytest.approx(target.joints, abs=2e-3)
    places, _ = ROBOT.tool_frames(Side.RIGHT, np.array(log.joints))
    fastest = np.linalg.norm(np.diff(places, axis=0), axis=1).max() * FOLLOWER_HZ
    assert 0.15 < fastest < 0.2 * 1.05


def test_stop_comes_to_rest_before_it_lets_go_and_takes_the_confirmation_back() -> None:
    duo = ready_rig()
    log = Log(duo)
    move_on(duo)
    duo.stop()
    assert np.array_equal(log.velocities[-1], np.zeros(7))
    changes = np.abs(np.diff(np.array(log.velocities), axis=0))
    assert changes.max() <= MAX_ACCELERATION / FOLLOWER_HZ * 1.001
    assert is_tracking(duo) == [False, False]
    assert not duo.supervisor.is_confirmed
    duo.stop()


# --- 2: nothing moves before the operator confirmed ----------------------------------------------


def test_nothing_is_told_to_any_device_before_the_operator_confirmed() -> None:
    duo = new_rig()
    duo.start()
    before = joints(duo)
    for move in (duo.home, lambda: duo.command(shifted(0.1))):
        assert "before the operator has confirmed" in refused(move)
    wait(duo, 1.0)
    assert is_tracking(duo) == [False, False]
    assert np.array_equal(joints(duo), before)
    duo.supervisor.confirm()
    wait(duo, 1.0)
    duo.supervisor.revoke()
    assert "before the operator has confirmed" in refused(duo.home)
    assert [arm(duo, side).commands for side in SIDES] == [0, 0]


def test_home_is_slow_and_ends_at_home_with_open_grippers() -> None:
    duo = new_rig()
    put(duo, HOME_JOINTS + AWAY)
    logs = [Log(duo, side) for side in SIDES]
    confirmed(duo).home()
    fraction = duo.rig.arms[Side.LEFT].home_fraction
    for log in logs:
        fastest = np.abs(log.velocities).max(axis=0)
        assert (fastest <= fraction * np.array(VELOCITY_LIMITS) + 1e-9).all()
        assert fastest.max() > 0.05
        path = np.array(log.joints)
        share = (path[:, 0] - path[0, 0]) / (path[-1, 0] - path[0, 0])
        line = path[0] + share[:, None] * (path[-1] - path[0])
        assert np.abs(path - line).max() < 0.01  # the way that the guard has looked at
    assert duo.read().joints == pytest.approx(HOME_JOINTS, abs=2e-3)
    assert duo.read().openings.min() > 0.99
    assert duo.supervisor.state is State.READY


@pytest.mark.parametrize("tool_speed", [0.05, 0.25])
def test_a_tool_that_may_not_be_fast_is_led_home_on_the_same_line(tool_speed: float) -> None:
    duo = new_rig(simulated_rig(tool_speed=tool_speed, home_fraction=0.4))
    put(duo, HOME_JOINTS + AWAY)
    log = Log(duo)
    confirmed(duo).home()
    told = np.array(log.joints)
    share = (told[:, 0] - told[0, 0]) / (told[-1, 0] - told[0, 0])
    line = told[0] + share[:, None] * (told[-1] - told[0])
    assert np.abs(told - line).max() < 0.01  # the way that the guard has looked at
    places, _ = ROBOT.tool_frames(Side.LEFT, told)
    fastest = np.linalg.norm(np.diff(places, axis=0), axis=1).max() * FOLLOWER_HZ
    assert 0.5 * tool_speed < fastest < 1.05 * tool_speed


def test_followers_begin_at_the_measured_joints() -> None:
    duo = confirmed(new_rig())
    put(duo, HOME_JOINTS + AWAY)  # moved by hand after connecting
    logs = [Log(duo, side) for side in SIDES]
    duo.command(shifted(0.0))
    for side, log in zip(SIDES, logs, strict=True):
        first = HOME_JOINTS[side.index] + AWAY
        assert log.joints[0] == pytest.approx(first, abs=1e-3)
        assert np.abs(np.diff([first, *log.joints], axis=0)).max() < 0.003


# --- 3: bounds -----------------------------------------------------------------------------------


@pytest.mark.parametrize("fraction", [0.25, MAX_SPEED_FRACTION])
def test_whatever_is_commanded_an_arm_is_told_only_what_its_bounds_allow(fraction: float) -> None:
    duo = ready_rig(simulated_rig(speed_fraction=fraction))
    logs = [Log(duo, side) for side in SIDES]
    rng = np.random.default_rng(0)
    ends = [np.full((2, 7), 9.0)] * 75
    for targets in [*rng.uniform(-4, 5, (30, 2, 7)), *ends]:
        sent = duo.command(DuoCommand(joints=targets, openings=rng.uniform(0, 1, 2)))
        assert np.array_equal(sent.joints, np.clip(sent.joints, LOWEST, HIGHEST))
    most = fraction * np.array(VELOCITY_LIMITS)
    for log in logs:
        told, moving = np.array(log.joints), np.array(log.velocities)
        assert np.array_equal(told, np.clip(told, LOWEST, HIGHEST))
        assert (np.abs(moving) <= most + 1e-9).all()
        assert (np.abs(np.diff(told, axis=0)) <= most / FOLLOWER_HZ + 1e-9).all()
        assert np.abs(np.diff(moving, axis=0)).max() <= MAX_ACCELERATION / FOLLOWER_HZ * 1.001
        assert np.abs(moving).max() > 0.2


def test_a_far_target_is_approached_and_reached_not_jumped_to() -> None:
    duo = ready_rig()
    log, target = Log(duo), shifted(0.5)
    first = duo.command(target)
    assert first.joints[0, 0] - HOME_JOINTS[0, 0] <= 0.5 * VELOCITY_LIMITS[0] * PERIOD + 1e-9
    steps = 1
    while not np.array_equal(duo.command(target).flat, target.flat):
        steps += 1
    assert 10 <= steps <= 20
    for _ in range(15):
        duo.command(target)
    assert duo.read().joints == pytest.approx(target.joints, abs=2e-3)
    assert np.abs(np.diff(np.array(log.joints), axis=0)).max() < 0.5 * 5.26 / FOLLOWER_HZ


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_before_anything_moves(wrong: float) -> None:
    duo = ready_rig()
    time, before = duo.clock.now(), joints(duo)
    bad = shifted(0.1)
    bad.joints[1, 3] = wrong
    with pytest.raises(ActionError, match="Nothing was moved"):
        duo.command(bad)
    assert duo.clock.now() == time
    wait(duo, 0.2)
    assert joints(duo) == pytest.approx(before, abs=1e-4)


# --- 4: stalls -----------------------------------------------------------------------------------


def stalled(duo: FrankaDuo) -> tuple[DuoCommand, Log]:
    """A policy that moves on quickly and then says nothing more."""
    log = Log(duo)
    move_on(duo)
    return duo.last_command, log


def test_arms_come_to_rest_at_the_last_target_of_a_policy_that_stalls() -> None:
    duo = ready_rig()
    last, log = stalled(duo)
    wait(duo, 1.0)
    assert np.array_equal(log.velocities[-1], np.zeros(7))
    assert joints(duo) == pytest.approx(last.joints, abs=1e-3)
    assert np.abs(speeds(duo)).max() < 1e-3
    # It never goes further than braking takes, whatever the last two targets would promise.
    furthest = last.joints[0, 0] + 0.9**2 / (2 * MAX_ACCELERATION) + 1e-3
    assert max(told[0] for told in log.joints) <= furthest
    assert duo.held is None
    duo.command(shifted(0.2))
    assert duo.held is None


def test_after_two_periods_without_a_command_nothing_asks_for_speed_any_more() -> None:
    duo = ready_rig()
    _, log = stalled(duo)
    speed = log.velocities[-1][0]
    wait(duo, 2 * PERIOD)
    braked = speed - MAX_ACCELERATION * PERIOD  # one period to the end of the ramp, one to brake
    assert log.velocities[-1][0] <= braked + 0.05


def test_arms_stop_damped_when_a_policy_says_nothing_for_long(soon: float) -> None:
    duo = ready_rig()
    stalled(duo)
    wait(duo, soon - 1.0)
    assert duo.held is None
    wait(duo, 2.0)
    assert (duo.held or "").startswith("No command came for 3 s")
    assert is_tracking(duo) == [False, False]
    assert "before the operator has confirmed" in refused(duo.home)
    home(duo)
    assert is_tracking(duo) == [True, True]


# --- 7: what a rig's file says, and that it starts low -------------------------------------------


def test_a_new_rig_starts_low() -> None:
    config = ArmConfig()
    assert config.torque_threshold == (20.0,) * 4 + (8.0,) * 3
    assert (config.force_threshold, config.moment_threshold) == (30.0, 8.0)
    assert config.tool_speed == 0.25  # the reduced speed of ISO 10218-1
    gripper = GripperConfig()
    assert (gripper.mm_per_s(GRIPPER) < 60.0, gripper.newtons(GRIPPER) < 45.0) == (
        True,
        True,
    )
    assert (config.speed_fraction, config.acceleration, config.home_fraction) == (0.25, 4.0, 0.1)


@pytest.mark.parametrize("slow", SIDES)
@pytest.mark.parametrize(("name", "value"), [("speed_fraction", 0.1), ("acceleration", 1.0)])
def test_speed_and_acceleration_of_each_arm_are_those_of_the_rigs_file(
    name: str, value: Any, slow: Side
) -> None:
    duo = ready_rig(simulated_rig([slow], **{name: value}))
    logs = {side: Log(duo, side) for side in SIDES}
    for _ in range(30):
        duo.command(shifted(0.8))
    fastest = {}
    for side, log in logs.items():
        moving, limits = np.array(log.velocities)[:, 0], duo.rig.arms[side]
        speed, acceleration = np.abs(moving).max(), np.abs(np.diff(moving)).max() * FOLLOWER_HZ
        assert speed <= limits.speed_fraction * VELOCITY_LIMITS[0] + 1e-9
        assert acceleration <= limits.acceleration * 1.001
        fastest[side] = speed, acceleration
    assert np.max(np.divide(fastest[slow.other], fastest[slow])) > 2.0
