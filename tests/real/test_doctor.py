"""The doctor of a rig, on simulated devices that are well, and on ones that are not."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.types import SIDES, Side
from duobench.real.devices import ArmReading
from duobench.real.doctor.checks import Check, CheckOutcome, is_well, write_checks
from duobench.real.doctor.computer import computer_checks
from duobench.real.doctor.examine import SUCCESS_RATE, examine, mount_check
from duobench.real.duo import FrankaDuo
from duobench.real.mounts import gravity_torques
from duobench.real.rig import ArmConfig, CameraConfig, Rig
from duobench.results.labels import FaultKind
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.rigs import arm, camera, confirmed, gripper, joints, new_rig
from tests.real.simulated import CAMERA, SimulatedArm, SimulatedCamera, simulated_rig

SECONDS = 2.0
OK, SKIPPED, FAILED = CheckOutcome.OK, CheckOutcome.SKIPPED, CheckOutcome.FAILED
IN_TIME = "control commands in time"
Change = Callable[[FrankaDuo], None]


class TellingArm(SimulatedArm):
    """A simulated arm that tells how many commands reach it, and feels gravity."""

    success = 1.0
    torques = np.zeros(7)

    def read(self) -> ArmReading:
        reading = super().read()
        state = {**reading.state, SUCCESS_RATE: np.array([self.success])}
        return replace(reading, torques=self.torques, state=state)


def telling_rig() -> FrankaDuo:
    duo = new_rig()
    arms = {side: TellingArm(duo.rig.arms[side], duo.clock) for side in SIDES}
    return FrankaDuo(duo.rig, duo.clock, arms=arms, grippers=duo.grippers, cameras=duo.cameras)


def found(duo: FrankaDuo, **options: Any) -> Mapping[str, Check]:
    try:
        checks = examine(duo, seconds=SECONDS, **options)
    finally:
        duo.close()
    by_name = {check.name: check for check in checks}
    assert len(by_name) == len(checks), "names are told apart"
    return by_name


def test_a_simulated_rig_is_well() -> None:
    checks = found(confirmed(new_rig()))
    assert is_well(checks.values())
    assert checks["holding"].outcome is checks["head camera"].outcome is OK
    assert checks["head camera"].value.startswith("30.")
    assert checks["realtime kernel"].outcome in {OK, SKIPPED}
    assert checks[IN_TIME].outcome is SKIPPED


def test_nothing_moves_and_nothing_is_held_without_the_operators_word() -> None:
    duo = telling_rig()
    checks = found(duo)
    assert checks["holding"].outcome is checks[IN_TIME].outcome is SKIPPED
    assert [arm(duo, side).commands for side in SIDES] == [0, 0]


@pytest.mark.parametrize(("success", "outcome"), [(1.0, OK), (0.995, OK), (0.97, FAILED)])
def test_arms_hold_where_they_are_and_lost_control_commands_are_found(
    success: float, outcome: CheckOutcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TellingArm, "success", success)
    duo = confirmed(telling_rig())
    check = found(duo)[IN_TIME]
    assert (check.outcome, bool(check.advice)) == (outcome, outcome is FAILED)
    assert f"{success:.1%}" in check.value
    assert min(arm(duo, side).commands for side in SIDES) > 100
    np.testing.assert_allclose(joints(duo), HOME_JOINTS, atol=1e-6)


def test_an_arm_that_does_not_answer_ends_the_examination() -> None:
    duo = new_rig()
    arm(duo, Side.LEFT).is_reachable = False
    checks = found(duo)
    assert checks["connection"].outcome is FAILED
    assert "does not answer" in checks["connection"].value
    assert "holding" not in checks


def test_a_fault_while_holding_is_told() -> None:
    duo = confirmed(new_rig())
    arm(duo, Side.RIGHT).fail("cartesian_reflex")
    check = found(duo)["holding"]
    assert check.outcome is FAILED
    assert "cartesian_reflex" in check.value


def slow_camera(duo: FrankaDuo) -> None:
    duo.cameras["right_wrist"] = SimulatedCamera(
        CameraConfig(driver=CAMERA, fps=15), duo.clock, "right_wrist"
    )
    duo.cameras["right_wrist"].connect()


def toggle_camera(duo: FrankaDuo) -> None:
    head = camera(duo, "head")
    duo.clock.every(0.4, lambda: setattr(head, "is_silent", not head.is_silent), "toggle")


HOT = FaultKind.COMMUNICATION.fault("it is too hot")
SLOW = [0.031, 0.033, 0.032]


@pytest.mark.parametrize(
    ("change", "name", "words"),
    [
        (
            lambda duo: setattr(duo.cameras["left_wrist"], "is_silent", True),
            "left_wrist camera",
            "has given no image",
        ),
        (lambda duo: gripper(duo, Side.LEFT).fail(HOT), "left gripper", "too hot"),
        (
            lambda duo: setattr(duo.grippers["left"], "is_active", False),
            "left gripper",
            "not active",
        ),
        (
            lambda duo: setattr(duo.grippers[Side.LEFT], "round_trips", SLOW),
            "left gripper",
            "answers in 32.0 ms",
        ),
        (lambda duo: setattr(duo.cameras["head"], "usb", "2.1"), "head camera", "USB 2.1"),
        (slow_camera, "right_wrist camera", "15.0 images a second of 30"),
        (toggle_camera, "head camera", r", (2\d|3\d|40) lost"),
    ],
)
def test_devices_that_are_not_well_are_found(change: Change, name: str, words: str) -> None:
    duo = new_rig()
    duo.start()
    change(duo)
    checks = found(duo)
    assert checks[name].outcome is FAILED
    assert re.search(words, checks[name].value)
    assert is_well(check for other, check in checks.items() if other not in {name, "holding"})


class DeepCamera(SimulatedCamera):
    """Knows the depth of a share of its pixels; of none of them it gives none."""

    share = 0.0

    def _depth(self) -> Any:
        depth = np.zeros(self.config.size, np.float32)
        depth[: round(self.share * len(depth))] = 0.4
        return depth if self.share else None


@pytest.mark.parametrize(
    ("share", "outcome", "words"),
    [(0.0, FAILED, "it gives none"), (0.25, CheckOutcome.NOTE, "25%"), (0.75, OK, "75%")],
)
def test_depth_that_a_camera_does_not_know_is_found(
    monkeypatch: pytest.MonkeyPatch, share: float, outcome: CheckOutcome, words: str
) -> None:
    monkeypatch.setattr(DeepCamera, "share", share)
    rig = simulated_rig()
    driver = f"{__name__}:{DeepCamera.__name__}"
    deep = replace(rig.cameras["left_wrist"], driver=driver, depth=True)
    checks = found(new_rig(replace(rig, cameras={**rig.cameras, "left_wrist": deep})))
    check = checks["left_wrist camera's depth"]
    assert (check.outcome, words in check.value) == (outcome, True)
    assert "head camera's depth" not in checks


@pytest.mark.parametrize(("fps", "outcome"), [(8, FAILED), (10, OK)])
def test_a_camera_for_which_arms_would_rest_is_found(fps: int, outcome: CheckOutcome) -> None:
    rig = simulated_rig()
    rig = replace(rig, cameras={"head": replace(rig.cameras["head"], fps=fps)})
    check = found(new_rig(rig))["head camera"]
    assert (check.outcome, "raise fps" in check.advice) == (outcome, outcome is FAILED)


def test_without_opencv_nothing_is_said_about_the_head_cameras_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    reference = np.zeros((720, 1280, 3), np.uint8)
    check = found(new_rig(), reference=reference)["head camera's place"]
    assert (check.outcome, check.value) == (CheckOutcome.NOTE, "OpenCV is not installed")
    assert "hardware" in check.advice


# --- left and right ------------------------------------------------------------------------------


def test_swapped_arms_are_found_by_their_torques() -> None:
    def checked(torques: np.ndarray) -> Check:
        plain = new_rig().readings()
        felt = {side: replace(plain[side], torques=torques[side.index]) for side in SIDES}
        return mount_check(felt, ROBOT)

    noise = np.random.default_rng(0).normal(0, 0.5, (2, 7))
    right_way = gravity_torques(HOME_JOINTS, ROBOT) + noise
    swapped = checked(gravity_torques(HOME_JOINTS[::-1], ROBOT)[::-1] + noise)
    assert "swapped" in swapped.advice
    others = [checked(torques).outcome for torques in (right_way, right_way + 60.0, 0 * noise)]
    assert [swapped.outcome, *others] == [FAILED, OK, CheckOutcome.NOTE, SKIPPED]


# --- the computer --------------------------------------------------------------------------------


def real_rig(*, is_realtime: bool = True) -> Rig:
    arms = {
        side: ArmConfig(address=f"127.0.0.{1 + side.index}", is_realtime=is_realtime)
        for side in SIDES
    }
    return replace(simulated_rig(), arms=arms)


@pytest.mark.parametrize(
    ("rig", "kernel", "outcome"),
    [
        (real_rig(), "0", FAILED),
        (real_rig(), "1", OK),
        (real_rig(is_realtime=False), "0", SKIPPED),
        (simulated_rig(), "0", SKIPPED),
    ],
)
def test_real_arms_need_a_realtime_kernel(
    rig: Rig, kernel: str, outcome: CheckOutcome, tmp_path: Path
) -> None:
    governor = tmp_path / "devices/system/cpu/cpu0/cpufreq/scaling_governor"
    for path, text in ((tmp_path / "kernel/realtime", kernel), (governor, "powersave")):
        path.parent.mkdir(parents=True)
        path.write_text(f"{text}\n")
    checks = {check.name: check for check in computer_checks(rig, sys=tmp_path)}
    assert checks["realtime kernel"].outcome is outcome
    assert checks["processor speed"].outcome is (OK if outcome is SKIPPED else CheckOutcome.NOTE)
    assert ("franky-control" in checks) is (not rig.is_computed)


def test_the_file_says_what_was_found(tmp_path: Path) -> None:
    checks = [OK.of("a", "1"), FAILED.of("b", "2", "Do it.")]
    path = write_checks(tmp_path / "run", "lab", "abc", checks)
    document = json.loads(path.read_text())
    assert path.name == "doctor.json"
    assert (document["rig"], document["rig_hash"], document["is_well"]) == ("lab", "abc", False)
    assert document["checks"][1]["advice"] == "Do it."
