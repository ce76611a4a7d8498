"""Safety rules 5 and 6: any fault holds both arms, and only the operator recovers them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import BackendError
from duobench.core.types import SIDES, Side
from duobench.data import DataSet, Recorder
from duobench.real.duo import FrankaDuo
from duobench.real.env import make_real_env
from duobench.real.supervisor import State
from duobench.real.watchdog import GRACE_S
from duobench.results.labels import FaultKind
from tests.real.rigs import (
    Log,
    arm,
    camera,
    confirmed,
    gripper,
    home,
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
from tests.real.simulated import SimulatedArm, SimulatedCamera, SimulatedGripper

RIGHT = Side.RIGHT
BROKEN = FaultKind.COMMUNICATION.fault("overheated")
Device, Strike = Callable[[FrankaDuo], Any], Callable[[Any], None]
ARM, GRIPPER = partial(arm, side=RIGHT), partial(gripper, side=RIGHT)
CAMERA = partial(camera, name="head")


def silence(device: SimulatedArm | SimulatedGripper | SimulatedCamera) -> None:
    device.is_silent = True


COMMUNICATION, CONTROLLER = FaultKind.COMMUNICATION, FaultKind.CONTROLLER
CONTACT = FaultKind.CONTACT
EACH = pytest.mark.parametrize(
    ("device", "strike", "kind", "text"),
    [
        (ARM, lambda arm: arm.fail("cartesian_reflex"), CONTACT, "The right arm: cartesian_reflex"),
        (ARM, lambda arm: arm.fail("network", COMMUNICATION), COMMUNICATION, "right arm: network"),
        (ARM, SimulatedArm.stop, CONTROLLER, "The right arm follows no more commands"),
        (ARM, silence, COMMUNICATION, "The right arm has given no reading"),
        (
            GRIPPER,
            lambda gripper: gripper.fail(BROKEN),
            COMMUNICATION,
            "The right gripper: overheated",
        ),
        (GRIPPER, silence, COMMUNICATION, "has not answered for"),
        (CAMERA, lambda camera: camera.fail(BROKEN), COMMUNICATION, "The camera head: overheated"),
        (CAMERA, silence, COMMUNICATION, "latest image of the camera head"),
    ],
    ids=("reflex", "packet", "stopped", "gone", "gripper", "mute gripper", "camera", "stale"),
)


@EACH
def test_a_fault_of_one_device_holds_both_arms_though_nobody_asks(
    device: Device, strike: Strike, kind: FaultKind, text: str
) -> None:
    duo = ready_rig()
    move_on(duo, 10)
    strike(device(duo))
    wait(duo, 0.75)  # nobody sends or asks anything
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
def test_both_arms_brake_within_a_moment(
    device: Device, strike: Strike, kind: FaultKind, text: str
) -> None:
    duo = ready_rig()
    log, number = Log(duo), 10
    move_on(duo, number)
    strike(device(duo))
    start = duo.clock.now()
    while duo.held is None:
        number += 1
        duo.command(shifted(0.03 * number))
    grace = GRACE_S if "image" in text else 0.0  # in which the arms rest
    assert duo.clock.now() - start <= 0.25 + grace
    wait(duo, 0.3)
    # Straight to rest, not to the last target and back to it.
    told = [velocities[0] for velocities in log.velocities]
    assert min(told[-120:]) >= 0.0
    assert told[-1] == 0.0
    assert duo.fault is not None
    assert (duo.fault.kind, text in duo.fault.text) == (kind, True)


@EACH
def test_an_episode_ends_with_the_reason_and_nothing_recorded_is_lost(
    device: Device, strike: Strike, kind: FaultKind, text: str, tmp_path: Path
) -> None:
    duo = new_rig()
    env = Recorder(make_real_env(duo, "bin_sort", image_size=(24, 32)), tmp_path)
    duo.supervisor.confirm()
    observation, _ = env.reset(seed=1)
    action = observation["agent_pos"]
    steps, truncated, info = 0, False, {}
    while not truncated:
        if steps == 5:
            strike(device(duo))
        _, _, _, truncated, info = env.step(action)
        steps += 1
    assert text in info["truncation_reason"]
    assert info["fault_kind"] == kind
    assert steps < 20
    (recording,) = DataSet.open(tmp_path).recordings()
    assert len(recording.sent) in {steps, steps + 1}
    assert recording.info.outcome is not None
    assert text in (recording.info.outcome.reason or "")
    assert "Recover" in refused(env.reset)
    env.close()


def test_only_the_operator_recovers_and_then_has_to_confirm_before_home() -> None:
    duo = ready_rig()
    arm(duo, RIGHT).fail()
    wait(duo, 0.1)
    for move in (duo.home, duo.supervisor.confirm):
        assert "Recover" in refused(move)
    assert duo.supervisor.state is State.FAULTED
    duo.supervisor.recover()
    assert (duo.held, duo.fault, duo.supervisor.state) == (None, None, State.CONNECTED)
    told = [arm(duo, side).commands for side in SIDES]
    wait(duo, 1.0)
    assert [arm(duo, side).commands for side in SIDES] == told
    assert "before the operator has confirmed" in refused(duo.home)
    home(duo)
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
    assert "The fault stays" in refused(duo.supervisor.recover)
    assert [*states, duo.supervisor.state] == [State.FAULTED, State.RECOVERING, State.FAULTED]
    assert "locked" in (duo.held or "")


def test_a_gripper_that_is_still_silent_keeps_the_rig_faulted() -> None:
    duo = ready_rig()
    silence(gripper(duo, RIGHT))
    wait(duo, 1.0)
    assert "has not answered" in refused(duo.supervisor.recover)
    gripper(duo, RIGHT).is_silent = False
    duo.supervisor.recover()
    assert duo.supervisor.state is State.CONNECTED


def test_the_first_reason_is_kept_and_a_fault_goes_before_a_persons_hold() -> None:
    duo = ready_rig()
    duo.hold("A person.")
    duo.hold("Another one.")
    assert duo.held == "A person."
    arm(duo, RIGHT).fail("What is wrong.")
    wait(duo, 0.1)
    assert duo.fault is not None
    assert duo.held == duo.fault.text
    duo.hold("The episode is over.")
    assert "What is wrong." in duo.held
    assert duo.supervisor.state is State.FAULTED
    assert "Recover" in refused(duo.home)


def test_a_fault_on_the_way_home_holds_both_arms_there() -> None:
    duo = new_rig()
    put(duo, shifted(0.4).joints)
    confirmed(duo)
    ticker = duo.clock.every(0.5, arm(duo, RIGHT).fail, "a reflex")
    assert "did not get home: The right arm: cartesian_reflex" in refused(duo.home)
    ticker.stop()
    wait(duo, 0.3)
    assert np.abs(speeds(duo)).max() < 1e-3
    assert joints(duo)[0, 0] > shifted(0.2).joints[0, 0]


def test_an_arm_that_cannot_begin_to_track_leaves_the_other_one_alone() -> None:
    duo = confirmed(new_rig())

    def refuse() -> None:
        raise BackendError("The brakes are closed.")

    arm(duo, RIGHT).start = refuse  # type: ignore[method-assign]
    assert "brakes are closed" in refused(duo.home)
    assert not duo.readings()[Side.LEFT].is_tracking
    assert duo.supervisor.state is State.FAULTED


def test_a_rig_with_a_device_that_cannot_be_reached_stays_off() -> None:
    duo = new_rig()
    arm(duo, RIGHT).is_reachable = False
    assert "does not answer" in refused(duo.start)
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


# --- images that come late ------------------------------------------------------------------------


def test_arms_rest_until_a_late_image_comes_and_the_episode_goes_on() -> None:
    duo = new_rig()
    env = make_real_env(duo, "bin_sort", cameras=("head",), image_size=(24, 32))
    duo.supervisor.confirm()
    env.reset(seed=1)
    move_on(duo)
    log, head = Log(duo), camera(duo, "head")
    head.is_silent = True
    back = duo.clock.every(0.35, lambda: silence_no_more(head), "the camera comes back")
    infos = [env.step(shifted(0.45 + 0.01 * step).flat)[-1] for step in range(1, 10)]
    back.stop()
    assert [info["waits"] for info in infos] == sorted(info["waits"] for info in infos)
    assert infos[-1]["waits"] == 1, "counted once"
    assert "truncation_reason" not in infos[-1]
    assert np.array_equal(min(log.velocities, key=np.linalg.norm), np.zeros(7)), "it came to rest"
    env.reset(seed=2)
    assert env.step(shifted(0.0).flat)[-1]["waits"] == 0, "of this episode"
    env.close()


def silence_no_more(device: SimulatedCamera) -> None:
    device.is_silent = False


def test_a_camera_that_nobody_sees_may_be_silent_while_an_episode_runs() -> None:
    duo = new_rig()
    env = make_real_env(duo, "bin_sort", cameras=("head",), image_size=(24, 32))
    duo.supervisor.confirm()
    observation, _ = env.reset(seed=1)
    for name in set(duo.cameras) - {"head"}:
        camera(duo, name).is_silent = True
    for _ in range(40):
        *_, truncated, info = env.step(observation["agent_pos"])
    assert (truncated, info["waits"], set(info["image_ages"])) == (False, 0, {"head"})
    env.close()
