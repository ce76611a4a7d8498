"""The driver of the gripper, against an imitated one on a pseudo-terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import ActionError, BackendError
from duobench.real.clock import Clock, SystemClock, VirtualClock
from duobench.real.devices import GripperReading
from duobench.real.drivers.robotiq import READ_HZ, RobotiqGripper, Status, measure_ends
from duobench.real.registers import ACTIVATE, GO
from duobench.real.rig import GripperConfig, GripperDriver
from duobench.results.labels import FaultKind
from tests.real.robotiq_fake import FakeGripper

PATIENT_S = 20.0
"""Answers take as long as they take on a busy machine; virtual time does not pass meanwhile."""


def gripper_at(port: str, clock: Clock, answer_s: float = PATIENT_S) -> RobotiqGripper:
    config = GripperConfig(driver=GripperDriver.ROBOTIQ, port=port, speed=200, force=50)
    return RobotiqGripper(config, clock, answer_s=answer_s)


@dataclass
class Bench:
    """A gripper, its driver and their time."""

    clock: VirtualClock
    fake: FakeGripper
    gripper: RobotiqGripper

    def wait(self, seconds: float) -> GripperReading:
        self.clock.wait_until(self.clock.now() + seconds)
        return self.gripper.read()

    def go(self, opening: float, seconds: float = 1.0) -> GripperReading:
        self.gripper.command(opening)
        return self.wait(seconds)

    def fault_text(self, kind: FaultKind) -> str:
        fault = self.gripper.read().fault
        assert fault is not None
        assert fault.kind is kind
        return fault.text

    def set_silent(self, is_silent: bool) -> None:
        """Have no answer come; it is given up at once, which costs real time."""
        self.gripper._port.client.comm_params.timeout_connect = 0.01 if is_silent else PATIENT_S
        self.fake.cable.is_silent = is_silent


@contextmanager
def benched(
    *, connect: bool = True, answer_s: float = PATIENT_S, **options: Any
) -> Iterator[Bench]:
    clock = VirtualClock()
    fake = FakeGripper(clock.now, **options)
    gripper = gripper_at(fake.port, clock, answer_s)
    try:
        if connect:
            gripper.connect()
        yield Bench(clock, fake, gripper)
    finally:
        gripper.close()
        gripper.close()  # twice is harmless
        fake.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    """A gripper that was not activated yet."""
    with benched() as made:
        yield made


@pytest.fixture
def active(bench: Bench) -> Bench:
    """A gripper that a person has activated."""
    bench.gripper.activate()
    return bench


def test_nothing_moves_before_a_person_says_so(bench: Bench) -> None:
    reading = bench.go(0.0)
    assert (reading.is_active, reading.opening, reading.fault) == (False, 1.0, None)
    assert bench.fake.goals == []


def test_it_goes_to_openings_at_its_speed(active: Bench) -> None:
    assert 0.5 < active.go(0.5, 0.1).opening < 1.0
    reading = active.wait(1.0)
    assert reading.opening == pytest.approx(0.5, abs=1 / 225)
    assert not reading.has_object
    assert reading.time_s == pytest.approx(active.clock.now(), abs=1.1 / READ_HZ)
    assert active.go(-3.0).opening == 0.0
    assert active.fake.goals[-1] == (ACTIVATE | GO, 228, 200 << 8 | 50)


def test_a_goal_is_written_once(active: Bench) -> None:
    before = len(active.fake.goals)
    for step in range(60):
        active.go(0.6 + 1e-4 * (step % 2), 1 / 30)  # less than a count
    assert len(active.fake.goals) == before + 1


def test_an_object_between_the_fingers_is_noticed(active: Bench) -> None:
    active.fake.object_at = 120
    reading = active.go(0.0)
    assert (reading.has_object, reading.opening) == (True, pytest.approx((228 - 120) / 225))
    assert not active.go(1.0).has_object


def test_holding_stops_moving_fingers_and_keeps_a_grip(active: Bench) -> None:
    active.go(0.0, 0.2)
    active.gripper.hold()
    active.wait(0.1)
    stopped = active.fake.position
    assert 3 < stopped < 200
    active.wait(1.0)
    assert active.fake.position == stopped
    active.fake.object_at = 200
    active.go(0.0)
    assert active.fake.position == 200, "a command after holding is followed"
    count = len(active.fake.goals)
    active.gripper.hold()
    assert active.wait(0.5).has_object
    assert len(active.fake.goals) == count, "a grip would lose its force"


def test_a_program_that_starts_again_leaves_a_grip_alone() -> None:
    with benched(active=True) as bench:
        bench.gripper.activate()
        bench.gripper.hold()
        assert bench.wait(1.0).is_active
        assert bench.fake.goals == []


@pytest.mark.parametrize("code", [0x08, 0x0A, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F])
def test_faults_are_told(code: int, active: Bench) -> None:
    active.fake.registers.fault = code
    active.wait(0.1)
    assert f"0x{code:02X}" in active.fault_text(FaultKind.COMMUNICATION)
    active.gripper.activate()
    assert active.gripper.read().fault is None


@pytest.mark.parametrize("code", [0x05, 0x07, 0x09])
def test_notes_are_no_faults(code: int, bench: Bench) -> None:
    bench.fake.registers.fault = code
    assert bench.wait(0.1).fault is None


def test_lost_power_is_a_fault_until_the_next_activation(active: Bench) -> None:
    active.fake.lose_power()
    active.wait(0.1)
    assert "lost its power" in active.fault_text(FaultKind.COMMUNICATION)
    commands = len(active.fake.goals)
    active.go(0.0, 0.1)
    assert len(active.fake.goals) == commands
    active.gripper.activate()
    assert active.gripper.read().fault is None


def test_an_activation_that_does_not_end_raises(bench: Bench) -> None:
    bench.fake.registers.jams = True
    with pytest.raises(BackendError, match="was not activated: it took over 15 s"):
        bench.gripper.activate()


def test_silence_is_a_fault_in_time_and_ends(active: Bench) -> None:
    active.set_silent(True)
    assert active.wait(0.15).fault is None
    active.wait(0.1)
    assert "has not answered" in active.fault_text(FaultKind.COMMUNICATION)
    active.set_silent(False)
    assert active.wait(0.1).fault is None


def test_a_command_that_was_lost_is_written_again(active: Bench) -> None:
    active.set_silent(True)
    active.go(0.0, 0.1)
    active.set_silent(False)
    active.wait(1.0)
    assert active.fake.position == 228


def test_a_pulled_cable_is_a_fault_and_a_new_one_ends_it(tmp_path: Path) -> None:
    port = tmp_path / "by-id"
    with benched(active=True, connect=False) as bench, benched(active=True, connect=False) as new:
        port.symlink_to(bench.fake.port)
        bench.gripper = gripper_at(str(port), bench.clock)
        bench.gripper.connect()
        bench.fake.cable.pull()
        port.unlink()
        bench.wait(0.5)
        assert "has not answered" in bench.fault_text(FaultKind.COMMUNICATION)
        port.symlink_to(new.fake.port)
        assert bench.wait(2.0).fault is None
        assert bench.fake.goals == new.fake.goals == []
        bench.gripper.close()


def test_a_gripper_of_another_number_does_not_answer() -> None:
    with benched(device_id=1, connect=False, answer_s=0.05) as bench:
        with pytest.raises(BackendError, match=r"No gripper answers at .* as device 9"):
            bench.gripper.connect()
        with pytest.raises(BackendError, match="after it was connected"):
            bench.gripper.read()


def test_a_port_that_is_missing_or_in_use_is_named(tmp_path: Path, bench: Bench) -> None:
    for port, words in (
        (str(tmp_path / "ttyUSB0"), "No such file"),
        (bench.fake.port, "another program uses it"),
    ):
        with pytest.raises(BackendError, match=rf"cannot be opened: {words}"):
            gripper_at(port, bench.clock, 0.05).connect()
    assert bench.gripper.read().fault is None


def test_an_opening_that_is_no_number_is_refused(bench: Bench) -> None:
    with pytest.raises(ActionError, match="got nan"):
        bench.gripper.command(float("nan"))


def test_ends_are_measured() -> None:
    with benched(connect=False) as bench:
        bench.fake.registers.ends = (5, 221)
        config = GripperConfig(port=bench.fake.port, force=50)
        found = measure_ends(config, bench.clock, answer_s=PATIENT_S)
        assert found == replace(config, open_count=5, closed_count=221)
        bench.fake.object_at = 100
        with pytest.raises(BackendError, match="between its fingers"):
            measure_ends(config, bench.clock, answer_s=PATIENT_S)


def test_it_is_read_in_a_thread_of_its_own() -> None:
    clock = SystemClock()
    fake = FakeGripper(clock.now, active=True)
    gripper, end = gripper_at(fake.port, clock), clock.now() + 60.0
    try:
        gripper.connect()
        gripper.command(0.0)
        while gripper.read().opening > 0.0:
            assert clock.now() < end
            clock.wait_until(clock.now() + 0.005)
        assert fake.position == 228
        assert gripper.round_trips
    finally:
        gripper.close()
        fake.close()


def test_registers_mean_what_the_manual_says() -> None:
    status = Status.of([0b10_11_1_001 << 8, 0x0900 | 255, 117 << 8 | 12])
    assert status == Status(is_activated=True, contact=2, fault=9, position=117)
    assert not Status.of([0b00_01_0_001 << 8, 0, 0]).is_activated
