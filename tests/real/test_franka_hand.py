"""A Franka Hand: one rule leads from targets to motions of its server."""

import math
from collections.abc import Iterator
from itertools import pairwise

import pytest

from duobench.core.errors import ActionError, BackendError, OptionError
from duobench.core.types import CONTROL_HZ
from duobench.real.clock import VirtualClock
from duobench.real.drivers.franka_hand import HOLD_S, FrankaHand, ImitatedHand, Motion
from duobench.real.opening import rehearsal_rig
from duobench.real.rig import ArmConfig, GripperConfig, Rig
from duobench.results.labels import FaultKind
from duobench.world.robot.gripper import FRANKA_HAND

STEP = 1.0 / CONTROL_HZ


class Bench:
    """A hand whose fingers move at the speed of the real ones, and may meet something."""

    def __init__(self, *, is_active: bool = True) -> None:
        self.clock, self.server = VirtualClock(), ImitatedHand(is_active=is_active)
        self.starts: list[float] = []
        self.thing = 0.0
        self.hand = FrankaHand(GripperConfig(), self.clock, port=self.server)
        self.clock.every(0.002, self._move, "fingers")
        self.hand.connect()

    def _move(self) -> None:
        if len(self.starts) < len(self.server.motions):
            self.starts.append(self.clock.now())
        target = self.server.target
        place = self.server.position
        if target is not None:
            way = 0.002 * FRANKA_HAND.speeds[1] / FRANKA_HAND.stroke
            place += min(max(target - place, -way), way)
            place = min(place, 1.0 - self.thing / FRANKA_HAND.stroke)
        self.server.move(place, self.clock.now())

    def lead(self, *openings: float) -> None:
        for opening in openings:
            self.hand.command(opening)
            self.wait(STEP)

    def wait(self, seconds: float) -> None:
        self.clock.wait_until(self.clock.now() + seconds)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.hand.close()


def test_targets_that_stream_start_a_motion_only_so_often(bench: Bench) -> None:
    bench.lead(*[1.0 - number / 60 for number in range(60)])
    assert 5 <= len(bench.starts) <= 11
    assert all(two - one > HOLD_S - 1e-9 for one, two in pairwise(bench.starts))
    assert all(motion.grasps for motion in bench.server.motions[1:])
    bench.wait(1.0)
    assert bench.hand.read().opening == pytest.approx(0.0, abs=0.03)


def test_a_newer_target_stops_what_runs(bench: Bench) -> None:
    bench.lead(0.0)
    bench.wait(0.3)
    before = bench.hand.read().opening
    bench.lead(1.0)
    bench.wait(0.3)
    assert 0.5 < before < bench.hand.read().opening


def test_a_homing_that_is_held_ends_unfinished() -> None:
    bench = Bench(is_active=False)
    bench.clock.every(0.5, bench.hand.hold, "person")
    with pytest.raises(BackendError, match="was not homed: it was stopped"):
        bench.hand.activate()
    assert bench.clock.now() < 1.0, "at once"
    bench.wait(0.5)
    stopped = bench.hand.read().opening
    bench.wait(0.5)
    assert 0.0 < stopped == bench.hand.read().opening < 1.0
    bench.hand.close()


def test_closing_grasps_and_holds_and_opening_moves(bench: Bench) -> None:
    bench.thing = 0.032
    bench.lead(0.0)
    bench.wait(1.0)
    assert bench.server.motions == [Motion(width=0.0, grasps=True)]
    reading = bench.hand.read()
    assert (reading.has_object, reading.opening) == (True, pytest.approx(0.4))
    bench.lead(0.0, 0.1, 0.05, 0.2)
    bench.wait(1.0)
    assert len(bench.server.motions) == 1, "a grip is left alone by what closes further"
    bench.lead(0.9)
    bench.wait(1.0)
    assert bench.server.motions[1] == Motion(width=pytest.approx(0.072), grasps=False)
    assert bench.hand.read().opening == pytest.approx(0.9, abs=0.01)
    assert not bench.hand.read().has_object


def test_a_hold_stops_the_fingers_and_keeps_a_grip(bench: Bench) -> None:
    bench.lead(0.0)
    bench.wait(0.2)
    bench.hand.hold()
    bench.wait(0.1)
    stopped = bench.hand.read().opening
    bench.wait(1.0)
    assert 0.1 < stopped < 0.9
    assert bench.hand.read().opening == stopped
    bench.thing = 0.032
    bench.lead(0.0)
    bench.wait(1.0)
    bench.hand.hold()
    bench.wait(0.5)
    assert bench.hand.read().has_object


def test_a_hand_that_lost_its_power_has_to_be_homed_again(bench: Bench) -> None:
    bench.wait(0.1)
    assert bench.hand.read().fault is None
    bench.server._is_homed = False
    bench.wait(0.1)
    fault = bench.hand.read().fault
    assert fault is not None
    assert "lost its power" in fault.text
    bench.hand.recover()
    assert bench.hand.read().fault is None
    bench.hand.activate()
    assert bench.hand.read().is_active


def test_it_moves_nowhere_before_a_person_had_it_homed() -> None:
    bench = Bench(is_active=False)
    bench.lead(0.0)
    bench.wait(0.5)
    assert not bench.server.motions
    assert not bench.hand.read().is_active
    bench.hand.activate()
    assert bench.hand.read().is_active
    assert bench.hand.read().opening == pytest.approx(1.0, abs=0.02)
    bench.server.has_power = False
    bench.wait(1.0)
    fault = bench.hand.read().fault
    assert fault is not None
    assert fault.kind is FaultKind.COMMUNICATION
    with pytest.raises(ActionError):
        bench.hand.command(math.nan)
    bench.hand.close()


def test_its_rig_says_the_address_of_its_arm() -> None:
    usual = rehearsal_rig("franka_hand")
    arms = {side: ArmConfig(address=f"172.16.{side.index}.2") for side in usual.arms}
    hands = {
        side: GripperConfig(driver="franka_hand", port=arm.address) for side, arm in arms.items()
    }
    rig = Rig(name="lab", arms=arms, grippers=hands, gripper="franka_hand")
    assert rig.robot.gripper is FRANKA_HAND
    wrong = {side: GripperConfig(driver="franka_hand", port="172.16.9.2") for side in arms}
    with pytest.raises(OptionError, match="address of its arm"):
        Rig(name="lab", arms=arms, grippers=wrong, gripper="franka_hand")
    with pytest.raises(OptionError, match=r"grippers\.left\.driver is robotiq"):
        Rig(name="lab", arms=arms, grippers=hands)


def test_without_the_library_it_says_which_extra_brings_it() -> None:
    with pytest.raises(BackendError, match="hardware"):
        FrankaHand(GripperConfig(port="172.16.0.2"), VirtualClock()).connect()
