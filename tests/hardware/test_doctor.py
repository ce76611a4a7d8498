"""The doctor of a rig, on simulated devices that are well, and on ones that are not."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.hardware.clock import VirtualClock
from duobench.hardware.devices import ArmReading, Fault, FaultKind
from duobench.hardware.doctor import Check, Outcome, examine, is_well, write_checks
from duobench.hardware.doctor.computer import computer_checks
from duobench.hardware.doctor.examine import SUCCESS_RATE, gravity_torques, mount_check
from duobench.hardware.drivers.simulated import SimulatedArm, SimulatedCamera
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.opening import open_rig
from duobench.hardware.rig import ArmConfig, ArmDriver, Rig
from duobench.robot.joints import HOME_JOINTS
from duobench.types import SIDES, Side

SECONDS = 2.0
Change = Callable[[FrankaDuo], None]


class TellingArm(SimulatedArm):
    """A simulated arm that tells how many commands reach it, and feels gravity."""

    success = 1.0
    torques = np.zeros(7)

    def read(self) -> ArmReading:
        reading = super().read()
        state = {**reading.state, SUCCESS_RATE: np.array([self.success])}
        return replace(reading, torques=self.torques, state=state)


def opened(arms: type[SimulatedArm] = SimulatedArm) -> FrankaDuo:
    duo = open_rig("simulated", VirtualClock(), guard=False)
    if arms is SimulatedArm:
        return duo
    made: dict[Side, Any] = {side: arms(duo.clock, HOME_JOINTS[side.index]) for side in SIDES}
    return FrankaDuo(
        duo.rig, duo.clock, arms=made, grippers=duo.grippers, cameras=duo.cameras, guard=None
    )


def found(duo: FrankaDuo, **options: Any) -> Mapping[str, Check]:
    try:
        checks = examine(duo, seconds=SECONDS, **options)
    finally:
        duo.close()
    by_name = {check.name: check for check in checks}
    assert len(by_name) == len(checks), "names are told apart"
    return by_name


def confirmed(duo: FrankaDuo) -> FrankaDuo:
    duo.start()
    duo.supervisor.confirm()
    return duo


def test_a_simulated_rig_is_well() -> None:
    checks = found(confirmed(opened()))
    assert is_well(checks.values())
    assert checks["holding"].outcome is Outcome.OK
    assert checks["head camera"].outcome is Outcome.OK
    assert checks["head camera"].value.startswith("30.")
    assert checks["realtime kernel"].outcome in {Outcome.OK, Outcome.SKIPPED}
    assert checks["control commands in time"].outcome is Outcome.SKIPPED


def test_nothing_moves_and_nothing_is_held_without_the_operators_word() -> None:
    duo = opened(TellingArm)
    checks = found(duo)
    assert checks["holding"].outcome is Outcome.SKIPPED
    assert checks["control commands in time"].outcome is Outcome.SKIPPED
    assert [arm.commands for arm in duo.arms.values()] == [0, 0]  # type: ignore[attr-defined]


def test_arms_hold_where_they_are() -> None:
    duo = confirmed(opened(TellingArm))
    checks = found(duo)
    assert checks["control commands in time"].outcome is Outcome.OK
    for side in SIDES:
        arm = duo.arms[side]
        assert isinstance(arm, TellingArm)
        assert arm.commands > 100
        np.testing.assert_allclose(arm.read().joints, HOME_JOINTS[side.index], atol=1e-6)


@pytest.mark.parametrize(("success", "outcome"), [(0.995, Outcome.OK), (0.97, Outcome.FAILED)])
def test_lost_control_commands_are_found(success: float, outcome: Outcome) -> None:
    duo = confirmed(opened(TellingArm))
    for arm in duo.arms.values():
        arm.success = success  # type: ignore[attr-defined]
    check = found(duo)["control commands in time"]
    assert check.outcome is outcome
    assert f"{success:.1%}" in check.value
    assert bool(check.advice) is (outcome is Outcome.FAILED)


def test_an_arm_that_does_not_answer_ends_the_examination() -> None:
    duo = opened()
    duo.arms[Side.LEFT].is_reachable = False  # type: ignore[attr-defined]
    checks = found(duo)
    assert checks["connection"].outcome is Outcome.FAILED
    assert "does not answer" in checks["connection"].value
    assert "holding" not in checks


def test_a_fault_while_holding_is_told() -> None:
    duo = confirmed(opened())
    duo.arms[Side.RIGHT].fail("cartesian_reflex")  # type: ignore[attr-defined]
    checks = found(duo)
    assert checks["holding"].outcome is Outcome.FAILED
    assert "cartesian_reflex" in checks["holding"].value


def silence(duo: FrankaDuo) -> None:
    duo.cameras["left_wrist"].is_silent = True  # type: ignore[attr-defined]


def break_gripper(duo: FrankaDuo) -> None:
    fault = Fault(kind=FaultKind.DEVICE, text="it is too hot")
    duo.grippers[Side.LEFT].fail(fault)  # type: ignore[attr-defined]


def slow_gripper(duo: FrankaDuo) -> None:
    duo.grippers[Side.LEFT].round_trips = [0.031, 0.033, 0.032]  # type: ignore[attr-defined]


def old_usb(duo: FrankaDuo) -> None:
    duo.cameras["head"].usb = "2.1"  # type: ignore[attr-defined]


def slow_camera(duo: FrankaDuo) -> None:
    duo.cameras["right_wrist"] = SimulatedCamera(duo.clock, fps=15)


@pytest.mark.parametrize(
    ("change", "name", "words"),
    [
        (silence, "left_wrist camera", "has given no image"),
        (break_gripper, "left gripper", "too hot"),
        (slow_gripper, "left gripper", "answers in 32.0 ms"),
        (old_usb, "head camera", "USB 2.1"),
        (slow_camera, "right_wrist camera", "15.0 images a second of 30"),
    ],
)
def test_devices_that_are_not_well_are_found(change: Change, name: str, words: str) -> None:
    duo = opened()
    duo.start()
    change(duo)
    if name.startswith("right_wrist"):
        duo.cameras["right_wrist"].connect()
    checks = found(duo)
    assert checks[name].outcome is Outcome.FAILED
    assert words in checks[name].value
    others = [check for other, check in checks.items() if other not in {name, "holding"}]
    assert is_well(others)


def test_lost_images_are_counted() -> None:
    duo = opened()
    duo.start()
    camera = duo.cameras["head"]
    toggled = duo.clock.every(0.4, lambda: setattr(camera, "is_silent", not camera.is_silent), "x")  # type: ignore[attr-defined]
    checks = found(duo)
    toggled.stop()
    check = checks["head camera"]
    assert check.outcome is Outcome.FAILED
    lost = int(check.value.split(", ")[1].split()[0])
    assert 20 <= lost <= 40


def test_without_opencv_nothing_is_said_about_the_head_cameras_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    reference = np.zeros((720, 1280, 3), np.uint8)
    check = found(opened(), reference=reference)["head camera's place"]
    assert (check.outcome, check.value) == (Outcome.NOTE, "OpenCV is not installed")
    assert "hardware" in check.advice


# --- left and right ------------------------------------------------------------------------------


def readings(torques: np.ndarray) -> dict[Side, ArmReading]:
    return {
        side: ArmReading(
            time_s=0.0,
            joints=np.array(HOME_JOINTS[side.index]),
            velocities=np.zeros(7),
            torques=torques[side.index],
            is_tracking=False,
        )
        for side in SIDES
    }


def test_swapped_arms_are_found_by_their_torques() -> None:
    joints = np.array(HOME_JOINTS)
    noise = np.random.default_rng(0).normal(0, 0.5, (2, 7))
    right_way = gravity_torques(joints) + noise
    assert mount_check(readings(right_way)).outcome is Outcome.OK
    swapped = gravity_torques(joints[::-1])[::-1] + noise
    check = mount_check(readings(swapped))
    assert check.outcome is Outcome.FAILED
    assert "swapped" in check.advice
    assert mount_check(readings(right_way + 60.0)).outcome is Outcome.NOTE
    assert mount_check(readings(np.zeros((2, 7)))).outcome is Outcome.SKIPPED


# --- the computer --------------------------------------------------------------------------------


def test_real_arms_need_a_realtime_kernel(tmp_path: Path) -> None:
    arms = {side: ArmConfig(driver=ArmDriver.FRANKY, address="x") for side in SIDES}
    real = replace(Rig.simulated(), arms=arms)
    (tmp_path / "kernel").mkdir()
    (tmp_path / "kernel" / "realtime").write_text("0\n")
    for rig, outcome in ((real, Outcome.FAILED), (Rig.simulated(), Outcome.SKIPPED)):
        checks = {check.name: check for check in computer_checks(rig, sys=tmp_path)}
        assert checks["realtime kernel"].outcome is outcome
        assert ("franky-control" in checks) is (rig is real)
    (tmp_path / "kernel" / "realtime").write_text("1\n")
    checks = {check.name: check for check in computer_checks(real, sys=tmp_path)}
    assert checks["realtime kernel"].outcome is Outcome.OK
    patient = {side: replace(arm, is_realtime=False) for side, arm in arms.items()}
    checks = {check.name: check for check in computer_checks(replace(real, arms=patient))}
    assert checks["realtime kernel"].outcome in {Outcome.OK, Outcome.SKIPPED}


def test_the_governor_is_told(tmp_path: Path) -> None:
    arms = {side: ArmConfig(driver=ArmDriver.FRANKY, address="x") for side in SIDES}
    folder = tmp_path / "devices/system/cpu/cpu0/cpufreq"
    folder.mkdir(parents=True)
    (folder / "scaling_governor").write_text("powersave\n")
    rig = replace(Rig.simulated(), arms=arms)
    checks = {check.name: check for check in computer_checks(rig, sys=tmp_path)}
    assert checks["processor speed"].outcome is Outcome.NOTE


def test_the_file_says_what_was_found(tmp_path: Path) -> None:
    checks = [
        Check(name="a", outcome=Outcome.OK, value="1"),
        Check(name="b", outcome=Outcome.FAILED, value="2", advice="Do it."),
    ]
    path = write_checks(tmp_path / "run", "lab", "abc", checks)
    document = json.loads(path.read_text())
    assert path.name == "doctor.json"
    assert (document["rig"], document["rig_hash"], document["is_well"]) == ("lab", "abc", False)
    assert document["checks"][1]["advice"] == "Do it."
