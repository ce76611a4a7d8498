"""All checks of a rig, in the order in which they are made."""

from collections.abc import Iterator, Mapping
from statistics import median

import numpy as np

from duobench.core.backend import Image
from duobench.core.errors import BackendError
from duobench.core.machine import install_extra
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.envs.duo_env import MAX_IMAGE_AGE_SECONDS
from duobench.real.canonical import CanonicalView
from duobench.real.catalog import is_computed, load_driver
from duobench.real.devices import ArmReading, Camera
from duobench.real.doctor.checks import Check, CheckOutcome
from duobench.real.doctor.computer import computer_checks
from duobench.real.duo import FrankaDuo
from duobench.real.mounts import (
    MAX_RATIO,
    SWAPPED,
    are_swapped,
    misfits,
)
from duobench.real.rig import CameraConfig, GripperConfig
from duobench.world.robot.cameras import HEAD
from duobench.world.robot.frames import Robot

HOLDING_S = 10.0
SUCCESS_RATE = "control_command_success_rate"
"""Key of a reading's state: the share of control commands that reached the arm in time."""
LEAST_SUCCESS = 0.99
LEAST_RATE = 0.95
"""Share of a camera's rate that has to come."""
LONGEST_ANSWER_S = 0.02
"""Longest median answer of a gripper; the timer of an adapter adds 16 ms unless turned off."""
LEAST_COVERAGE = 0.98
"""Share of the canonical image that a camera should see."""
LEAST_DEPTH = 0.5
"""Share of the pixels whose depth a camera should know [choice]."""


class _Measurement:
    """Counts of frames and commands while the arms hold."""

    def __init__(self, duo: FrankaDuo, seconds: float) -> None:
        """Hold for a time and count; without the operator's word only count."""
        self.duo = duo
        self.frames: dict[str, list[int]] = {name: [] for name in duo.cameras}
        self.rates: list[float] = []
        self.late: list[float] = []
        self.trouble: str | None = None
        for name, camera in duo.cameras.items():
            camera.listen(
                lambda frame, seen=self.frames[name]: seen.append(frame.index)
            )
        start = duo.clock.now()
        try:
            step = 0
            while duo.clock.now() < start + seconds:
                step += 1
                due = start + step / CONTROL_HZ
                if duo.supervisor.is_confirmed and duo.held is None:
                    duo.command(duo.last_command)
                else:
                    duo.clock.wait_until(due)
                self.late.append(duo.clock.now() - due)
                for reading in duo.readings().values():
                    if SUCCESS_RATE in reading.state:
                        self.rates.append(
                            float(np.ravel(reading.state[SUCCESS_RATE])[0])
                        )
        except BackendError as error:
            self.trouble = str(error)
        finally:
            self.seconds = duo.clock.now() - start
            for camera in duo.cameras.values():
                camera.listen(None)


def examine(
    duo: FrankaDuo, *, seconds: float = HOLDING_S, reference: Image | None = None
) -> tuple[Check, ...]:
    """Look at everything; the rig is started if it was not, and not closed.

    If the operator has confirmed (`duo.supervisor.confirm`) the arms hold where they are for a
    while, which measures how well they are reached; else that is skipped, and nothing moves. The
    reference is a canonical image of the head camera that was stored when it was calibrated. Errors
    of devices are failed checks.
    """
    checks = computer_checks(duo.rig)
    try:
        duo.start()
    except BackendError as error:
        return (*checks, CheckOutcome.FAILED.of("connection", str(error)))
    checks.append(CheckOutcome.OK.of("connection", "all devices answer"))
    measured = _Measurement(duo, seconds)
    checks += [*_arm_checks(measured), mount_check(duo.readings(), duo.robot)]
    checks += [_gripper_check(duo, side) for side in SIDES]
    for name, config in duo.rig.cameras.items():
        checks += _camera_checks(measured, name, config)
    if HEAD in duo.cameras:
        checks.append(_drift_check(duo, reference))
    return tuple(checks)


def _arm_checks(measured: _Measurement) -> Iterator[Check]:
    duo, seconds = measured.duo, measured.seconds
    is_confirmed = duo.supervisor.is_confirmed
    reason = measured.trouble or duo.held
    if reason is not None:
        yield CheckOutcome.FAILED.of("holding", reason)
    elif not is_confirmed:
        yield CheckOutcome.SKIPPED.of("holding", "the operator has not confirmed")
    elif measured.late:
        late = f"steps were late by {1000 * max(measured.late):.1f} ms at most"
        yield CheckOutcome.OK.of("holding", f"{seconds:.0f} s; {late}")
    name = "control commands in time"
    if not measured.rates:
        yield CheckOutcome.SKIPPED.of(name, "not told by these arms")
    elif not is_confirmed:
        yield CheckOutcome.SKIPPED.of(name, "only known while the arms hold")
    else:
        # The first ones are of the time before control.
        least = min(measured.rates[len(measured.rates) // 10 :])
        value = f"{least:.1%} at least over {seconds:.0f} s"
        advice = (
            "Look at the realtime kernel, at the network (one port and cable an arm, no switch), "
            "and move policies and images to another computer."
        )
        yield CheckOutcome.FAILED.unless(least >= LEAST_SUCCESS, name, value, advice)


def _gripper_check(duo: FrankaDuo, side: Side) -> Check:
    config, name = duo.rig.grippers[side], f"{side} gripper"
    reading = duo.grippers[side].read()
    if reading.fault is not None:
        return CheckOutcome.FAILED.of(name, reading.fault.text)
    value = f"{'active' if reading.is_active else 'not active'}, opening {reading.opening:.2f}"
    if not reading.is_active:
        return CheckOutcome.FAILED.of(
            name, value, "Activate it: duobench real grippers --activate"
        )
    answers = [float(each) for each in getattr(duo.grippers[side], "round_trips", ())]
    if not answers:
        return CheckOutcome.OK.of(name, value)
    typical = median(answers)
    value += (
        f", answers in {1000 * typical:.1f} ms ({1000 * max(answers):.1f} ms at most)"
    )
    if typical > LONGEST_ANSWER_S:
        advice = (
            "Set the latency timer of its adapter to 1 ms (see the page real_setup)."
        )
        return CheckOutcome.FAILED.of(name, value, advice)
    ends, usual = (
        (each.open_count, each.closed_count) for each in (config, GripperConfig())
    )
    has_ends = hasattr(load_driver("grippers", config.driver), "measure_ends")
    is_measured = not has_ends or ends != usual
    advice = f"Its ends are a typical gripper's; measure: duobench real calibrate gripper {side}"
    return CheckOutcome.NOTE.unless(is_measured, name, value, advice)


def _camera_checks(
    measured: _Measurement, name: str, config: CameraConfig
) -> Iterator[Check]:
    camera, frames = measured.duo.cameras[name], measured.frames[name]
    title = f"{name} camera"
    if camera.fault is not None:
        yield CheckOutcome.FAILED.of(title, camera.fault.text)
        return
    rate = len(frames) / measured.seconds if measured.seconds > 0.0 else 0.0
    lost = frames[-1] - frames[0] + 1 - len(frames) if frames else 0
    value = f"{rate:.1f} images a second of {config.fps}, {lost} lost"
    is_slow = rate < LEAST_RATE * config.fps - 1.0 / max(measured.seconds, 0.1)
    usb = getattr(camera, "usb", "")
    if usb:
        value += f", USB {usb}"
    is_old = bool(usb) and float(usb.split()[0]) < 3.0  # noqa: PLR2004 - USB 3
    advice = (
        "Plug it in again, quickly, into a USB 3 port of its own, with a short cable and without a "
        "hub."
    )
    is_rare = config.fps * MAX_IMAGE_AGE_SECONDS < 1.0
    if is_rare:
        advice = f"Arms rest where an image is older than {MAX_IMAGE_AGE_SECONDS:g} s: raise fps."
    yield CheckOutcome.FAILED.unless(
        not (is_slow or is_old or is_rare), title, value, advice
    )
    if config.depth:
        yield _depth_check(title, camera)
    if is_computed("cameras", config.driver):
        return
    if config.exposure_us is None:
        value = "chosen by the camera, which varies it"
        advice = "Lock exposure_us and gain in the rig's file."
        yield CheckOutcome.NOTE.of(f"{title}'s exposure", value, advice)
    title = f"{title}'s calibration"
    calibration = config.calibration
    if calibration is None:
        value = "none; its images are not remapped"
        yield CheckOutcome.NOTE.of(
            title, value, "To calibrate it, see the page real_cameras."
        )
        return
    coverage = CanonicalView(name, calibration, config.size).coverage
    value = (
        f"{calibration.date or 'no date'}, {calibration.error_px or 0:.2f} px; it sees "
        f"{coverage:.1%} of the simulation's image"
    )
    yield CheckOutcome.NOTE.unless(coverage >= LEAST_COVERAGE, title, value)


def _depth_check(title: str, camera: Camera) -> Check:
    name, frame = f"{title}'s depth", camera.latest()
    if frame is None or frame.depth is None:
        return CheckOutcome.FAILED.of(name, "it gives none, and the rig's file says so")
    share = float(np.mean(frame.depth > 0.0))
    value = f"known in {share:.0%} of its pixels"
    advice = "Clean its windows, light the table, and look at it from 7 to 50 cm."
    return CheckOutcome.NOTE.unless(share >= LEAST_DEPTH, name, value, advice)


# --- the place of the head camera ----------------------------------------------------------------

NOTED_SHIFT_PX, LARGEST_SHIFT_PX = 1.0, 3.0
"""Shift of the head camera that is remarked on, and from which it has to be calibrated again."""
TILE = 160
"""Edge in pixels of the tiles that are compared. The median of their shifts counts, so that arms
and objects that are elsewhere do not matter as long as most of the image is as it was."""
FEWEST_TILES = 6
"""Tiles that have to show the same in both images for a shift to be told."""
DISTINCT = 3.0
AGREEMENT = 0.25
"""Response of the phase correlation of a tile that shows the same thing [measured on rendered
images: 0.4 in the median; 0.16 at most between images of noise]."""


def shift_between(image: Image, reference: Image) -> tuple[float, float] | None:
    """Shift right and down in pixels of an image's content from one of the same size.

    None where too little of both is alike.
    """
    import cv2  # pyright: ignore[reportMissingImports]

    now, before = (each.astype(np.float64).mean(axis=-1) for each in (image, reference))
    window = cv2.createHanningWindow((TILE, TILE), cv2.CV_64F)
    shifts: list[tuple[float, float]] = []
    for top in range(0, now.shape[0] - TILE + 1, TILE // 2):
        for left in range(0, now.shape[1] - TILE + 1, TILE // 2):
            part = slice(top, top + TILE), slice(left, left + TILE)
            # Without its mean, which would agree wherever the tile is.
            tiles = [each[part] - each[part].mean() for each in (before, now)]
            if min(tile.std() for tile in tiles) <= DISTINCT:
                continue
            shift, response = cv2.phaseCorrelate(*tiles, window)
            if response >= AGREEMENT:
                shifts.append(shift)
    if len(shifts) < FEWEST_TILES:
        return None
    right, down = np.median(np.array(shifts), axis=0)
    return float(right), float(down)


def _drift_check(duo: FrankaDuo, reference: Image | None) -> Check:
    name = "head camera's place"
    if reference is None:
        return CheckOutcome.SKIPPED.of(name, "no reference was stored")
    if HEAD not in duo.frames():
        return CheckOutcome.FAILED.of(name, "it gives no image")
    image = duo.images([HEAD], (reference.shape[0], reference.shape[1]))[HEAD]
    try:
        shift = shift_between(image, reference)
    except ImportError:
        return CheckOutcome.NOTE.of(
            name, "OpenCV is not installed", install_extra("hardware")
        )
    if shift is None:
        value = "too little is as it was when the reference was stored"
        return CheckOutcome.NOTE.of(
            name, value, "Clear the table, bring the arms home, and look again."
        )
    pixels = float(np.hypot(*shift))
    value = f"{pixels:.1f} px from the reference ({shift[0]:+.1f}, {shift[1]:+.1f})"
    if pixels > LARGEST_SHIFT_PX:
        advice = "The camera was moved: move it back, or calibrate it again."
        return CheckOutcome.FAILED.of(name, value, advice)
    return CheckOutcome.NOTE.unless(pixels <= NOTED_SHIFT_PX, name, value)


# --- left and right ------------------------------------------------------------------------------


def mount_check(readings: Mapping[Side, ArmReading], robot: Robot) -> Check:
    """Say whether left and right are swapped, by the torques of both arms at rest."""
    name = "left and right arm"
    found = misfits(readings, robot)
    if found is None:
        return CheckOutcome.SKIPPED.of(name, "the arms feel no torques")
    own, other = found
    value = ", ".join(
        f"{side}: {own[side.index]:.1f} N·m off as {side}, {other[side.index]:.1f} as {side.other}"
        for side in SIDES
    )
    if are_swapped(readings, robot):
        return CheckOutcome.FAILED.of(name, value, SWAPPED)
    advice = (
        "Torques fit neither mount well: look at the mass of the tool that the control box knows, "
        "and at whether something touches an arm."
    )
    return CheckOutcome.NOTE.unless(
        bool(np.all(own <= MAX_RATIO * other)), name, value, advice
    )
