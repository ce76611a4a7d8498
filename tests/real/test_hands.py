"""The operator's word on the hands: grippers that were off overnight, and what is held at the end.

Grippers are spoken to by their driver, and imitated at the other end by the manual.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest

from duobench.core.types import SIDES, DuoCommand, Side
from duobench.real.clock import VirtualClock
from duobench.real.devices import ArmReading
from duobench.real.drivers.robotiq import RobotiqGripper
from duobench.real.duo import FrankaDuo
from duobench.real.guard import Guard
from duobench.real.mounts import gravity_torques
from duobench.real.opening import open_rig
from duobench.real.rig import GripperConfig
from duobench.real.supervisor import State
from duobench.real.way_home import RETREAT, retreated
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.rigs import (
    Log,
    arm,
    gripper,
    home,
    joints,
    move_on,
    new_rig,
    ready_rig,
    refused,
    wait,
)
from tests.real.robotiq_fake import FakeGripper
from tests.real.simulated import simulated_rig

PATIENT_S = 20.0
"""Answers take as long as they take on a busy machine; virtual time does not pass meanwhile."""
CLOSED = DuoCommand(joints=HOME_JOINTS, openings=np.zeros(2))


@dataclass
class Lab:
    """Simulated arms with grippers that speak by registers, as they are in the morning."""

    duo: FrankaDuo
    fakes: dict[Side, FakeGripper]

    def close_on(self, **counts: int) -> None:
        """Close both hands, some on an object that stops the fingers at so many counts."""
        for side in SIDES:
            self.fakes[side].object_at = counts.get(side)
        for _ in range(60):
            self.duo.command(CLOSED)

    def activate(self) -> None:
        self.duo.hands.activate()
        self.duo.supervisor.confirm()

    def begin(self) -> None:
        """Activate the hands, and go home."""
        self.activate()
        self.duo.home()

    @property
    def commands(self) -> int:
        return sum(len(fake.goals) for fake in self.fakes.values())


@pytest.fixture
def lab() -> Iterator[Lab]:
    clock = VirtualClock()
    fakes = {side: FakeGripper(clock.now) for side in SIDES}
    duo = open_rig(simulated_rig(), clock, guard=False)
    for side, fake in fakes.items():
        config = GripperConfig(driver="robotiq", port=fake.port)
        duo.grippers[side] = RobotiqGripper(config, clock, answer_s=PATIENT_S)
    made = Lab(
        FrankaDuo(
            duo.rig, clock, arms=duo.arms, grippers=duo.grippers, cameras=duo.cameras, guard=None
        ),
        fakes,
    )
    made.duo.start()
    made.duo.supervisor.confirm()
    yield made
    made.duo.close()
    for fake in fakes.values():
        fake.close()


def test_in_the_morning_nothing_moves_before_the_grippers_are_activated(lab: Lab) -> None:
    duo = lab.duo
    before = joints(duo)
    for move in (duo.home, lambda: duo.command(CLOSED), duo.hands.open):
        assert "Both grippers are not active" in refused(move)
    assert np.array_equal(joints(duo), before)
    assert lab.commands == 0
    lab.activate()
    assert duo.hands.inactive == ()
    duo.home()
    lab.close_on(left=120)
    assert duo.read().openings[0] == pytest.approx((228 - 120) / 225, abs=0.01)
    assert duo.hands.holding == (Side.LEFT,)


def test_what_both_hands_hold_is_not_pulled_apart(lab: Lab) -> None:
    duo = lab.duo
    lab.begin()
    lab.close_on(left=120, right=120)
    duo.hold("The episode is over.")
    wait(duo, 1.0)
    duo.supervisor.confirm()
    before = joints(duo)
    for with_object in (False, True):
        assert "Both hands hold something" in refused(partial(duo.home, with_object=with_object))
    assert joints(duo) == pytest.approx(before, abs=1e-6)
    duo.hands.open([Side.LEFT])
    assert duo.hands.holding == (Side.RIGHT,)
    assert "The right hand holds something" in refused(duo.home)
    duo.home(with_object=True)
    assert duo.hands.holding == ()
    assert (duo.supervisor.state, joints(duo)) == (
        State.READY,
        pytest.approx(HOME_JOINTS, abs=0.01),
    )


def test_a_gripper_that_lost_its_power_is_recovered_and_activated_again(lab: Lab) -> None:
    duo = lab.duo
    lab.begin()
    move_on(duo, 5)
    lab.fakes[Side.RIGHT].lose_power()
    wait(duo, 0.3)
    assert duo.supervisor.state is State.FAULTED
    assert "lost its power" in (duo.held or "")
    duo.supervisor.recover()
    duo.supervisor.confirm()
    assert "The right gripper is not active" in refused(duo.home)
    lab.begin()
    assert duo.supervisor.state is State.READY


def test_a_hold_stops_fingers_that_open_or_are_activated(lab: Lab) -> None:
    duo = lab.duo
    hold = duo.clock.every(0.4, lambda: duo.hold("The page is silent."), "somebody")
    assert "was stopped" in refused(duo.hands.activate)
    hold.stop()
    assert duo.hands.inactive == SIDES
    lab.begin()
    lab.close_on(left=200, right=200)
    duo.hold("The episode is over.")
    wait(duo, 0.5)
    hold = duo.clock.every(0.1, lambda: duo.hold("The page is silent."), "somebody")
    assert "were stopped while they opened" in refused(duo.hands.open)
    hold.stop()
    wait(duo, 0.2)
    stopped = [fake.position for fake in lab.fakes.values()]
    assert 3 < min(stopped) < 195
    wait(duo, 1.0)
    assert [fake.position for fake in lab.fakes.values()] == stopped
    duo.hands.open()


def test_hands_are_opened_after_a_fault_and_not_while_the_arms_move(lab: Lab) -> None:
    duo = lab.duo
    lab.begin()
    lab.close_on(left=120)
    assert "while the arms are held; the rig is running" in refused(duo.hands.open)
    arm(duo, Side.RIGHT).fail("cartesian_reflex")
    wait(duo, 0.3)
    duo.hands.open([Side.LEFT])
    assert duo.hands.holding == ()
    assert duo.supervisor.state is State.FAULTED


# --- the way home -------------------------------------------------------------------------------


def test_a_reset_in_full_motion_keeps_the_acceleration_of_the_rig() -> None:
    duo = ready_rig()
    logs = [Log(duo, side) for side in SIDES]
    move_on(duo)
    home(duo)
    for log in logs:
        velocities = np.array(log.velocities)
        assert np.abs(velocities).max() > 0.8
        changes = np.abs(np.diff(velocities, axis=0))
        assert changes.max() <= duo.rig.arms[Side.LEFT].acceleration / 500.0 * (1 + 1e-6)
        rests = np.flatnonzero(~velocities[1:].any(axis=1))
        assert len(rests) > 0, "it comes to rest before the way home"


def test_hands_go_back_along_their_own_axes_before_the_way_home() -> None:
    low = HOME_JOINTS.copy()
    low[:, 3] += 0.25
    away = retreated(low, ROBOT)
    for side in SIDES:
        before, after = (ROBOT.tool_pose(side, each[side.index]) for each in (low, away))
        back = before.rotation.T @ (after.translation - before.translation)
        assert back == pytest.approx([0.0, 0.0, -RETREAT], abs=2e-3)
        assert before.rotation.T @ after.rotation == pytest.approx(np.eye(3), abs=0.01)
    duo = ready_rig(guard=True)
    assert isinstance(duo.guard, Guard)
    assert duo.path_home() == [pytest.approx(HOME_JOINTS)], "nothing was grasped yet"
    gripper(duo, Side.LEFT).object_opening = 0.4
    for _ in range(30):
        duo.command(CLOSED)
    duo.hold("The episode is over.")
    wait(duo, 0.5)
    assert len(duo.path_home()) == 1, "with something in a hand the way is not prolonged"
    duo.hands.open()
    path = duo.path_home()
    assert len(path) == 2
    assert path[0] == pytest.approx(retreated(duo.read().joints, ROBOT))


def test_a_hold_between_confirmation_and_home_is_kept() -> None:
    duo = ready_rig()
    duo.hold("The button on the page.")
    duo.supervisor.confirm()
    duo.hold("The button on the page, again.")
    assert "before the operator has confirmed" in refused(duo.home)


# --- left and right -----------------------------------------------------------------------------


def test_swapped_arms_are_refused_at_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    duo = new_rig()
    felt = gravity_torques(HOME_JOINTS[::-1], ROBOT)[::-1]
    noise = np.random.default_rng(0).normal(0.0, 0.3, (2, 7))

    def heavy(side: Side) -> None:
        device = arm(duo, side)
        read = device.read

        def reading() -> ArmReading:
            return replace(read(), torques=(felt + noise)[side.index])

        monkeypatch.setattr(device, "read", reading)

    for side in SIDES:
        heavy(side)
    assert "The arms are swapped: exchange their addresses" in refused(duo.start)
    assert duo.supervisor.state is State.OFF
    felt = gravity_torques(HOME_JOINTS, ROBOT)
    duo.start()
    assert duo.supervisor.state is State.CONNECTED
