"""The driver of the gripper, against an imitated one on a pseudo-terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from duobench.errors import ActionError, BackendError
from duobench.hardware.clock import SystemClock, VirtualClock
from duobench.hardware.devices import FaultKind
from duobench.hardware.drivers.robotiq import (
    ACTIVATE,
    GO,
    READ_HZ,
    RobotiqGripper,
    Status,
    measure_ends,
)
from duobench.hardware.rig import GripperConfig, GripperDriver
from tests.hardware.robotiq_fake import FakeGripper

PATIENT_S = 20.0
"""Answers take as long as they take on a busy machine; virtual time does not pass meanwhile."""


def gripper_at(port: str, clock: VirtualClock | SystemClock, answer_s: float) -> RobotiqGripper:
    config = GripperConfig(driver=GripperDriver.ROBOTIQ, port=port, speed=200, force=50)
    return RobotiqGripper(config, clock, answer_s=answer_s)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def fake(clock: VirtualClock) -> Iterator[FakeGripper]:
    made = FakeGripper(clock.now)
    yield made
    made.close()


@pytest.fixture
def gripper(fake: FakeGripper, clock: VirtualClock) -> Iterator[RobotiqGripper]:
    made = gripper_at(fake.port, clock, PATIENT_S)
    made.connect()
    yield made
    made.close()


def wait(clock: VirtualClock, seconds: float) -> None:
    clock.wait_until(clock.now() + seconds)


def be_quick(gripper: RobotiqGripper) -> None:
    """Give silence up at once, which costs real time."""
    gripper._client.comm_params.timeout_connect = 0.01


def test_nothing_moves_before_a_person_says_so(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.command(0.0)
    wait(clock, 1.0)
    reading = gripper.read()
    assert (reading.is_active, reading.opening, reading.fault) == (False, 1.0, None)
    assert fake.goals == []


def test_it_goes_to_openings_at_its_speed(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.activate()
    gripper.command(0.5)
    wait(clock, 0.1)
    moving = gripper.read()
    assert 0.5 < moving.opening < 1.0
    wait(clock, 1.0)
    reading = gripper.read()
    assert reading.opening == pytest.approx(0.5, abs=1 / 225)
    assert not reading.has_object
    assert reading.time_s == pytest.approx(clock.now(), abs=1.1 / READ_HZ)
    gripper.command(-3.0)
    wait(clock, 1.0)
    assert gripper.read().opening == 0.0
    assert fake.goals[-1] == (ACTIVATE | GO, 228, 200 << 8 | 50)


def test_a_goal_is_written_once(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.activate()
    before = len(fake.goals)
    for step in range(60):
        gripper.command(0.6 + 1e-4 * (step % 2))  # less than a count
        wait(clock, 1 / 30)
    assert len(fake.goals) == before + 1


def test_an_object_between_the_fingers_is_noticed(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    fake.object_at = 120
    gripper.activate()
    gripper.command(0.0)
    wait(clock, 1.0)
    reading = gripper.read()
    assert reading.has_object
    assert reading.opening == pytest.approx((228 - 120) / 225)
    gripper.command(1.0)
    wait(clock, 1.0)
    assert not gripper.read().has_object


def test_holding_stops_moving_fingers_and_keeps_a_grip(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.activate()
    gripper.command(0.0)
    wait(clock, 0.2)
    gripper.hold()
    wait(clock, 0.1)
    stopped = fake.position
    assert 3 < stopped < 228
    wait(clock, 1.0)
    assert fake.position == stopped
    fake.object_at = 200
    gripper.command(0.0)
    wait(clock, 1.0)
    count = len(fake.goals)
    gripper.hold()
    wait(clock, 0.5)
    assert gripper.read().has_object
    assert len(fake.goals) == count, "a grip would lose its force"


def test_a_command_after_holding_is_followed(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.activate()
    gripper.command(0.0)
    wait(clock, 0.1)
    gripper.hold()
    wait(clock, 0.1)
    gripper.command(0.0)
    wait(clock, 1.0)
    assert fake.position == 228


def test_a_program_that_starts_again_leaves_a_grip_alone(clock: VirtualClock) -> None:
    fake = FakeGripper(clock.now, active=True)
    gripper = gripper_at(fake.port, clock, PATIENT_S)
    try:
        gripper.connect()
        gripper.activate()
        gripper.hold()
        wait(clock, 1.0)
        assert gripper.read().is_active
        assert fake.goals == []
    finally:
        gripper.close()
        fake.close()


@pytest.mark.parametrize("code", [0x08, 0x0A, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F])
def test_faults_are_told(
    code: int, fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.activate()
    fake.fault = code
    wait(clock, 0.1)
    fault = gripper.read().fault
    assert fault is not None
    assert fault.kind is FaultKind.DEVICE
    assert f"0x{code:02X}" in fault.text
    gripper.activate()
    assert gripper.read().fault is None


@pytest.mark.parametrize("code", [0x05, 0x07, 0x09])
def test_notes_are_no_faults(
    code: int, fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    fake.fault = code
    wait(clock, 0.1)
    assert gripper.read().fault is None


def test_lost_power_is_a_fault_until_the_next_activation(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.activate()
    fake.lose_power()
    wait(clock, 0.1)
    fault = gripper.read().fault
    assert fault is not None
    assert "lost its power" in fault.text
    commands = len(fake.goals)
    gripper.command(0.0)
    wait(clock, 0.1)
    assert len(fake.goals) == commands
    gripper.activate()
    assert gripper.read().fault is None


def test_an_activation_that_does_not_end_raises(fake: FakeGripper, gripper: RobotiqGripper) -> None:
    fake.jams = True
    with pytest.raises(BackendError, match="was not activated: it took over 15 s"):
        gripper.activate()


def test_silence_is_a_fault_in_time_and_ends(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.activate()
    be_quick(gripper)
    fake.cable.is_silent = True
    wait(clock, 0.15)
    assert gripper.read().fault is None
    wait(clock, 0.1)
    fault = gripper.read().fault
    assert fault is not None
    assert fault.kind is FaultKind.COMMUNICATION
    fake.cable.is_silent = False
    gripper._client.comm_params.timeout_connect = PATIENT_S
    wait(clock, 0.1)
    assert gripper.read().fault is None


def test_a_command_that_was_lost_is_written_again(
    fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    gripper.activate()
    be_quick(gripper)
    fake.cable.is_silent = True
    gripper.command(0.0)
    wait(clock, 0.1)
    fake.cable.is_silent = False
    gripper._client.comm_params.timeout_connect = PATIENT_S
    wait(clock, 1.0)
    assert fake.position == 228


def test_a_pulled_cable_is_a_fault_and_a_new_one_ends_it(tmp_path: Path) -> None:
    clock, port = VirtualClock(), tmp_path / "by-id"
    first, second = (FakeGripper(clock.now, active=True) for _ in range(2))
    port.symlink_to(first.port)
    gripper = gripper_at(str(port), clock, PATIENT_S)
    try:
        gripper.connect()
        first.cable.pull()
        port.unlink()
        wait(clock, 0.5)
        fault = gripper.read().fault
        assert fault is not None
        assert fault.kind is FaultKind.COMMUNICATION
        port.symlink_to(second.port)
        wait(clock, 2.0)
        assert gripper.read().fault is None
        assert first.goals == second.goals == []
    finally:
        gripper.close()
        first.close()
        second.close()


def test_a_gripper_of_another_number_does_not_answer(clock: VirtualClock) -> None:
    fake = FakeGripper(clock.now, device_id=1)
    gripper = gripper_at(fake.port, clock, 0.05)
    try:
        with pytest.raises(BackendError, match=r"No gripper answers at .* as device 9"):
            gripper.connect()
        with pytest.raises(BackendError, match="after it was connected"):
            gripper.read()
    finally:
        gripper.close()
        fake.close()


def test_a_port_that_is_missing_or_in_use_is_named(
    tmp_path: Path, fake: FakeGripper, gripper: RobotiqGripper, clock: VirtualClock
) -> None:
    with pytest.raises(BackendError, match=r"cannot be opened: No such file"):
        gripper_at(str(tmp_path / "ttyUSB0"), clock, 0.05).connect()
    with pytest.raises(BackendError, match=r"cannot be opened: another program uses it"):
        gripper_at(fake.port, clock, 0.05).connect()
    assert gripper.read().fault is None


def test_an_opening_that_is_no_number_is_refused(gripper: RobotiqGripper) -> None:
    with pytest.raises(ActionError, match="got nan"):
        gripper.command(float("nan"))


def test_ends_are_measured(fake: FakeGripper, clock: VirtualClock) -> None:
    fake.ends = (5, 221)
    config = GripperConfig(port=fake.port, force=50)
    found = measure_ends(config, clock, answer_s=PATIENT_S)
    assert (found.open_count, found.closed_count) == (5, 221)
    assert (found.port, found.force) == (fake.port, 50)
    fake.object_at = 100
    with pytest.raises(BackendError, match="between its fingers"):
        measure_ends(config, clock, answer_s=PATIENT_S)


def test_closing_twice_is_harmless(gripper: RobotiqGripper) -> None:
    gripper.close()
    gripper.close()


def test_it_is_read_in_a_thread_of_its_own() -> None:
    clock = SystemClock()
    fake = FakeGripper(clock.now, active=True)
    gripper = gripper_at(fake.port, clock, PATIENT_S)
    try:
        gripper.connect()
        gripper.command(0.0)
        wait_for(lambda: gripper.read().opening == 0.0)
        assert fake.position == 228
        assert gripper.round_trips
    finally:
        gripper.close()
        fake.close()


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_registers_mean_what_the_manual_says() -> None:
    status = Status.of([0b10_11_1_001 << 8, 0x0900 | 255, 117 << 8 | 12])
    assert status == Status(is_activated=True, contact=2, fault=9, position=117)
    assert not Status.of([0b00_01_0_001 << 8, 0, 0]).is_activated
