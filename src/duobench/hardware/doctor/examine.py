"""All checks of a rig, in the order in which they are made."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from statistics import median

import numpy as np

from duobench.backend import Image
from duobench.errors import BackendError
from duobench.hardware.canonical import CanonicalView
from duobench.hardware.devices import Frame
from duobench.hardware.doctor.checks import Check, Outcome
from duobench.hardware.doctor.computer import computer_checks
from duobench.hardware.doctor.drift import shift_between
from duobench.hardware.doctor.gravity import mount_check
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.rig import CameraConfig, CameraDriver, GripperConfig, GripperDriver
from duobench.types import CONTROL_HZ, HEAD, SIDES, Side

HOLDING_S = 10.0
"""Seconds of holding that are measured."""
SUCCESS_RATE = "control_command_success_rate"
"""Key of a reading's state: the share of control commands that reached the arm in time."""
LEAST_SUCCESS = 0.99
LEAST_RATE = 0.95
"""Share of a camera's rate that has to come."""
LONGEST_ANSWER_S = 0.02
"""Longest median answer of a gripper; the timer of an adapter adds 16 ms if nobody stops it."""
NOTED_SHIFT_PX, LARGEST_SHIFT_PX = 1.0, 3.0
"""Shift of the head camera that is remarked on, and from which it has to be calibrated again."""
LEAST_COVERAGE = 0.98
"""Share of the canonical image that a camera should see."""


class _Measurement:
    """What is counted while the arms hold."""

    def __init__(self, duo: FrankaDuo) -> None:
        self.duo = duo
        self.frames: dict[str, list[tuple[int, float]]] = {name: [] for name in duo.cameras}
        self.rates: list[float] = []
        self.late: list[float] = []
        self.seconds = 0.0
        self.trouble: str | None = None

    def run(self, seconds: float) -> None:
        """Hold for a time and count; without the operator's word only count."""
        duo = self.duo
        for name, camera in duo.cameras.items():
            camera.listen(self._counter(name))
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
                        self.rates.append(float(np.ravel(reading.state[SUCCESS_RATE])[0]))
        finally:
            self.seconds = duo.clock.now() - start
            for camera in duo.cameras.values():
                camera.listen(None)

    def _counter(self, name: str) -> Callable[[Frame], None]:
        return lambda frame: self.frames[name].append((frame.index, frame.time_s))


def examine(
    duo: FrankaDuo, *, seconds: float = HOLDING_S, reference: Image | None = None
) -> tuple[Check, ...]:
    """Look at everything; the rig is started if it was not, and not closed.

    If the operator has confirmed (`duo.supervisor.confirm`) the arms hold where they are for a
    while, which measures how well they are reached; else that is skipped, and nothing moves.

    Args:
        duo: The rig.
        seconds: How long is measured.
        reference: Canonical image of the head camera that was stored when it was calibrated.

    Returns:
        What was found, in order; errors of devices are failed checks.
    """
    checks = computer_checks(duo.rig)
    try:
        duo.start()
    except BackendError as error:
        failed = Check(name="connection", outcome=Outcome.FAILED, value=str(error))
        return (*checks, failed)
    checks.append(Check(name="connection", outcome=Outcome.OK, value="all devices answer"))
    measured = _Measurement(duo)
    try:
        measured.run(seconds)
    except BackendError as error:
        measured.trouble = str(error)
    checks += [*_arm_checks(measured), mount_check(duo.readings())]
    checks += [_gripper_check(duo, side) for side in SIDES]
    for name, config in duo.rig.cameras.items():
        checks += _camera_checks(measured, name, config)
    if HEAD in duo.cameras:
        checks.append(_drift_check(duo, reference))
    return tuple(checks)


def _arm_checks(measured: _Measurement) -> Iterator[Check]:
    duo, seconds = measured.duo, measured.seconds
    if (reason := measured.trouble or duo.held) is not None:
        yield Check(name="holding", outcome=Outcome.FAILED, value=reason)
    elif not duo.supervisor.is_confirmed:
        value = "the operator has not confirmed"
        yield Check(name="holding", outcome=Outcome.SKIPPED, value=value)
    elif measured.late:
        value = f"{seconds:.0f} s; steps were late by {1000 * max(measured.late):.1f} ms at most"
        yield Check(name="holding", outcome=Outcome.OK, value=value)
    name = "control commands in time"
    if not measured.rates:
        yield Check(name=name, outcome=Outcome.SKIPPED, value="not told by these arms")
    elif not duo.supervisor.is_confirmed:
        yield Check(name=name, outcome=Outcome.SKIPPED, value="only known while the arms hold")
    else:
        # The first ones are of the time before control.
        least = min(measured.rates[len(measured.rates) // 10 :])
        is_well = least >= LEAST_SUCCESS
        yield Check(
            name=name,
            outcome=Outcome.OK if is_well else Outcome.FAILED,
            value=f"{least:.1%} at least over {seconds:.0f} s",
            advice=""
            if is_well
            else "Look at the realtime kernel, at the network (one port and cable an arm, no "
            "switch), and move policies and images to another computer.",
        )


def _gripper_check(duo: FrankaDuo, side: Side) -> Check:
    config, name = duo.rig.grippers[side], f"{side} gripper"
    reading = duo.grippers[side].read()
    if reading.fault is not None:
        return Check(name=name, outcome=Outcome.FAILED, value=reading.fault.text)
    answers = [float(each) for each in getattr(duo.grippers[side], "round_trips", ())]
    active = "active" if reading.is_active else "not activated yet"
    value = f"{active}, opening {reading.opening:.2f}"
    if not answers:
        return Check(name=name, outcome=Outcome.OK, value=value)
    typical = median(answers)
    value += f", answers in {1000 * typical:.1f} ms ({1000 * max(answers):.1f} ms at most)"
    if typical > LONGEST_ANSWER_S:
        return Check(
            name=name,
            outcome=Outcome.FAILED,
            value=value,
            advice="Set the latency timer of its adapter to 1 ms (see docs/real_setup.md).",
        )
    nominal = GripperConfig()
    are_nominal = config.open_count == nominal.open_count
    are_nominal &= config.closed_count == nominal.closed_count
    if config.driver is GripperDriver.ROBOTIQ and are_nominal:
        advice = (
            f"Its ends are a typical gripper's; measure: duobench real calibrate gripper {side}"
        )
        return Check(name=name, outcome=Outcome.NOTE, value=value, advice=advice)
    return Check(name=name, outcome=Outcome.OK, value=value)


def _camera_checks(measured: _Measurement, name: str, config: CameraConfig) -> Iterator[Check]:
    camera, frames = measured.duo.cameras[name], measured.frames[name]
    title = f"{name} camera"
    if camera.fault is not None:
        yield Check(name=title, outcome=Outcome.FAILED, value=camera.fault.text)
        return
    rate = len(frames) / measured.seconds if measured.seconds > 0.0 else 0.0
    lost = frames[-1][0] - frames[0][0] + 1 - len(frames) if frames else 0
    value = f"{rate:.1f} images a second of {config.fps}, {lost} lost"
    is_slow = rate < LEAST_RATE * config.fps - 1.0 / max(measured.seconds, 0.1)
    facts = getattr(camera, "facts", None)
    usb = "" if facts is None else facts.usb
    if usb:
        value += f", USB {usb}"
    is_old = bool(usb) and float(usb.split()[0]) < 3.0  # noqa: PLR2004 - USB 3
    advice = ""
    if is_slow or is_old:
        advice = (
            "Plug it in again, quickly, into a USB 3 port of its own, with a short cable and "
            "without a hub."
        )
    yield Check(
        name=title,
        outcome=Outcome.FAILED if is_slow or is_old else Outcome.OK,
        value=value,
        advice=advice,
    )
    yield from _settings_checks(title, name, config)


def _settings_checks(title: str, name: str, config: CameraConfig) -> Iterator[Check]:
    if config.driver in {CameraDriver.SIMULATED, CameraDriver.FILE}:
        return
    if config.exposure_us is None:
        yield Check(
            name=f"{title}'s exposure",
            outcome=Outcome.NOTE,
            value="chosen by the camera, which varies it",
            advice="Lock exposure_us and gain in the rig's file.",
        )
    if config.calibration is None:
        yield Check(
            name=f"{title}'s calibration",
            outcome=Outcome.NOTE,
            value="none; its images are not remapped",
            advice="Calibrate it: docs/real_cameras.md.",
        )
        return
    coverage = CanonicalView(name, config.calibration, config.size).coverage
    yield Check(
        name=f"{title}'s calibration",
        outcome=Outcome.OK if coverage >= LEAST_COVERAGE else Outcome.NOTE,
        value=f"{config.calibration.date or 'no date'}, {config.calibration.error_px or 0:.2f} px; "
        f"it sees {coverage:.1%} of the simulation's image",
    )


def _drift_check(duo: FrankaDuo, reference: Image | None) -> Check:
    name = "head camera's place"
    if reference is None:
        return Check(name=name, outcome=Outcome.SKIPPED, value="no reference was stored")
    if HEAD not in duo.frames():
        return Check(name=name, outcome=Outcome.FAILED, value="it gives no image")
    image = duo.images([HEAD], (reference.shape[0], reference.shape[1]))[HEAD]
    shift = shift_between(image, reference)
    if shift is None:
        return Check(
            name=name,
            outcome=Outcome.NOTE,
            value="too little is as it was when the reference was stored",
            advice="Clear the table, bring the arms home, and look again.",
        )
    value = f"{shift.pixels:.1f} px from the reference ({shift.right:+.1f}, {shift.down:+.1f})"
    if shift.pixels > LARGEST_SHIFT_PX:
        advice = "The camera was moved: move it back, or calibrate it again."
        return Check(name=name, outcome=Outcome.FAILED, value=value, advice=advice)
    is_small = shift.pixels <= NOTED_SHIFT_PX
    return Check(name=name, outcome=Outcome.OK if is_small else Outcome.NOTE, value=value)
