"""Safety rules 5 and 6: any fault holds both arms, and only the operator recovers them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from duobench.data import DataSet, Recorder
from duobench.errors import BackendError
from duobench.hardware.devices import Fault, FaultKind
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.env import make_real_env
from duobench.hardware.supervisor import State
from duobench.types import SIDES, Array, Side
from tests.hardware.rigs import (
    arm,
    camera,
    gripper,
    joints,
    new_rig,
    ready_rig,
    shifted,
    speeds,
    wait,
)

RIGHT = Side.RIGHT
BROKEN = Fault(kind=FaultKind.DEVICE, text="overheated")


def silence(duo: FrankaDuo) -> None:
    arm(duo, RIGHT).is_silent = True


def silence_gripper(duo: FrankaDuo) -> None:
    gripper(duo, RIGHT).is_silent = True


def silence_camera(duo: FrankaDuo) -> None:
    camera(duo, "head").is_silent = True


FAULTS: dict[str, tuple[Callable[[FrankaDuo], None], FaultKind, str]] = {
    "a reflex": (
        lambda duo: arm(duo, RIGHT).fail("cartesian_reflex"),
        FaultKind.REFLEX,
        "The right arm: cartesian_reflex",
    ),
    "a lost packet": (
        lambda duo: arm(duo, RIGHT).fail("network", FaultKind.COMMUNICATION),
        FaultKind.COMMUNICATION,
        "The right arm: network",
    ),
    "an arm that stops without a word": (
        lambda duo: arm(duo, RIGHT).stop(),
        FaultKind.DEVICE,
        "The right arm follows no more commands",
    ),
    "an arm that is gone": (silence, FaultKind.COMMUNICATION, "The right arm has given no reading"),
    "a gripper's fault": (
        lambda duo: gripper(duo, RIGHT).fail(BROKEN),
        FaultKind.DEVICE,
        "The right gripper: overheated",
    ),
    "a gripper that is gone": (silence_gripper, FaultKind.COMMUNICATION, "has not answered for"),
    "a camera's fault": (
        lambda duo: camera(duo, "head").fail(BROKEN),
        FaultKind.DEVICE,
        "The camera head: overheated",
    ),
    "a stale camera": (silence_camera, FaultKind.COMMUNICATION, "latest image of the camera head"),
}
EACH = pytest.mark.parametrize("name", FAULTS)


@EACH
def test_a_fault_of_one_device_holds_both_arms_though_nobody_asks(name: str) -> None:
    strike, kind, text = FAULTS[name]
    duo = ready_rig()
    for number in range(1, 11):
        duo.command(shifted(0.03 * number))
    strike(duo)
    wait(duo, 0.6)  # nobody sends or asks anything
    assert duo.supervisor.state is State.FAULTED
    assert duo.fault is not None
    assert duo.fault.kind is kind
    assert text in (duo.held or "")
    assert np.abs(speeds(duo)[0]).max() < 1e-3
    where = joints(duo)[0]
    duo.command(shifted(1.0))
    wait(duo, 0.3)
    assert joints(duo)[0] == pytest.approx(where, abs=1e-3)


@EACH
def test_both_arms_brake_within_a_moment(name: str) -> None:
    strike, _, _ = FAULTS[name]
    duo = ready_rig()
    left = arm(duo, Side.LEFT)
    tell, told = left.command, []

    def command(joints: Array, velocities: Array) -> None:
        told.append(velocities[0])
        tell(joints, velocities)

    left.command = command  # type: ignore[method-assign]
    number = 0
    while number < 10:
        number += 1
        duo.command(shifted(0.03 * number))
    strike(duo)
    start = duo.clock.now()
    while duo.held is None:
        number += 1
        duo.command(shifted(0.03 * number))
    assert duo.clock.now() - start <= 0.25
    wait(duo, 0.3)
    # Straight to rest, not to the last target and back to it.
    assert min(told[-120:]) >= 0.0
    assert told[-1] == 0.0


@EACH
def test_an_episode_ends_with_the_reason_and_nothing_recorded_is_lost(
    name: str, tmp_path: Path
) -> None:
    strike, kind, text = FAULTS[name]
    duo = new_rig()
    env = Recorder(make_real_env(duo, "bin_sort", cameras=False), tmp_path)
    duo.supervisor.confirm()
    observation, _ = env.reset(seed=1)
    action = observation["agent_pos"]
    steps, truncated, info = 0, False, {}
    while not truncated:
        if steps == 5:
            strike(duo)
        _, _, _, truncated, info = env.step(action)
        steps += 1
    assert text in info["truncation_reason"]
    assert info["fault_kind"] == kind
    assert steps < 20
    (recording,) = DataSet.open(tmp_path).recordings()
    assert len(recording.sent) in {steps, steps + 1}
    assert recording.info.outcome is not None
    assert text in (recording.info.outcome.reason or "")
    with pytest.raises(BackendError, match="Recover"):
        env.reset()
    env.close()


def test_only_the_operator_recovers_and_then_has_to_confirm_before_home() -> None:
    duo = ready_rig()
    arm(duo, RIGHT).fail()
    wait(duo, 0.1)
    for move in (duo.home, duo.supervisor.confirm):
        with pytest.raises(BackendError, match="Recover"):
            move()
    assert duo.supervisor.state is State.FAULTED
    duo.supervisor.recover()
    assert (duo.held, duo.fault, duo.supervisor.state) == (None, None, State.CONNECTED)
    told = [arm(duo, side).commands for side in SIDES]
    wait(duo, 1.0)
    assert [arm(duo, side).commands for side in SIDES] == told
    with pytest.raises(BackendError, match="before the operator has confirmed"):
        duo.home()
    duo.supervisor.confirm()
    duo.home()
    assert duo.supervisor.state is State.READY


def test_a_fault_that_stays_keeps_the_rig_faulted() -> None:
    duo = ready_rig()
    arm(duo, RIGHT).fail("locked")
    wait(duo, 0.1)
    states = [duo.supervisor.state]

    def stay() -> None:
        states.append(duo.supervisor.state)
        raise BackendError("The fault stays.")

    arm(duo, RIGHT).recover = stay  # type: ignore[method-assign]
    with pytest.raises(BackendError, match="The fault stays"):
        duo.supervisor.recover()
    assert [*states, duo.supervisor.state] == [State.FAULTED, State.RECOVERING, State.FAULTED]
    assert "locked" in (duo.held or "")


def test_a_gripper_that_is_still_silent_keeps_the_rig_faulted() -> None:
    duo = ready_rig()
    silence_gripper(duo)
    wait(duo, 1.0)
    with pytest.raises(BackendError, match="has not answered"):
        duo.supervisor.recover()
    gripper(duo, RIGHT).is_silent = False
    duo.supervisor.recover()
    assert duo.supervisor.state is State.CONNECTED


def test_the_first_reason_is_kept_and_a_fault_goes_before_a_persons_hold() -> None:
    duo = ready_rig()
    duo.hold("A person.")
    duo.hold("Another one.")
    assert duo.held == "A person."
    arm(duo, RIGHT).fail()
    wait(duo, 0.1)
    assert duo.held == "A person."
    assert duo.fault is not None
    assert duo.supervisor.state is State.FAULTED
    with pytest.raises(BackendError, match="Recover"):
        duo.home()


def test_a_fault_on_the_way_home_holds_both_arms_there() -> None:
    duo = new_rig()
    for side in SIDES:
        arm(duo, side).put(shifted(0.4).joints[side.index])
    duo.start()
    duo.supervisor.confirm()
    ticker = duo.clock.every(0.5, arm(duo, RIGHT).fail, "a reflex")
    with pytest.raises(BackendError, match="did not get home: The right arm: cartesian_reflex"):
        duo.home()
    ticker.stop()
    wait(duo, 0.3)
    assert np.abs(speeds(duo)).max() < 1e-3
    assert joints(duo)[0, 0] > shifted(0.2).joints[0, 0]


def test_an_arm_that_cannot_begin_to_track_leaves_the_other_one_alone() -> None:
    duo = new_rig()
    duo.start()
    duo.supervisor.confirm()

    def refuse() -> None:
        raise BackendError("The brakes are closed.")

    arm(duo, RIGHT).start = refuse  # type: ignore[method-assign]
    with pytest.raises(BackendError, match="brakes are closed"):
        duo.home()
    assert not duo.readings()[Side.LEFT].is_tracking
    assert duo.supervisor.state is State.FAULTED


def test_a_rig_with_a_device_that_cannot_be_reached_stays_off() -> None:
    duo = new_rig()
    arm(duo, RIGHT).is_reachable = False
    with pytest.raises(BackendError, match="does not answer"):
        duo.start()
    assert duo.supervisor.state is State.OFF
    arm(duo, RIGHT).is_reachable = True
    duo.start()
    assert duo.supervisor.state is State.CONNECTED


def test_a_watch_that_fails_holds_both_arms() -> None:
    duo = ready_rig()
    duo.command(shifted(0.01))

    def fail() -> None:
        raise RuntimeError("a driver's own error")

    gripper(duo, RIGHT).read = fail  # type: ignore[method-assign,assignment]
    wait(duo, 0.1)
    assert duo.supervisor.state is State.FAULTED
    assert "a driver's own error" in (duo.held or "")
