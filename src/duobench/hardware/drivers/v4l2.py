"""Exposure and gain of a video device of Linux, by its own controls. Not tried on hardware."""

from __future__ import annotations

import fcntl
import os
import struct
from pathlib import Path

from duobench.errors import BackendError

_SET = 0xC008561C
"""VIDIOC_S_CTRL of <linux/videodev2.h>: an identifier and a value of 32 bits each."""
_EXPOSURE_MODE, _EXPOSURE, _WHITE_BALANCE, _GAIN = 0x009A0901, 0x009A0902, 0x0098090C, 0x00980913
_MANUAL = 1
_EXPOSURE_UNIT_US = 100.0


def lock_exposure(device: str, exposure_us: float | None, gain: float | None) -> None:
    """Set what is given, and keep the camera from changing it and its white balance.

    Args:
        device: A video device, such as /dev/video0.
        exposure_us: Exposure in microseconds, in steps of 100; None leaves it alone.
        gain: Gain in the camera's units; None leaves it alone.

    Raises:
        BackendError: The device has no such control, or does not take the value.
    """
    controls: list[tuple[str, int, int]] = []
    if exposure_us is not None:
        controls += [
            ("manual exposure", _EXPOSURE_MODE, _MANUAL),
            ("exposure", _EXPOSURE, round(exposure_us / _EXPOSURE_UNIT_US)),
            ("fixed white balance", _WHITE_BALANCE, 0),
        ]
    if gain is not None:
        controls.append(("gain", _GAIN, round(gain)))
    if not controls:
        return
    try:
        descriptor = os.open(device, os.O_RDWR | os.O_NONBLOCK)
    except OSError as error:
        raise BackendError(f"{device} cannot be opened: {error.strerror}.") from error
    try:
        for what, number, value in controls:
            try:
                fcntl.ioctl(descriptor, _SET, struct.pack("=Ii", number, value))
            except OSError as error:
                raise BackendError(
                    f"{device} does not take {what} {value}: {error.strerror}. Leave exposure_us "
                    "and gain out of the rig to let the camera choose."
                ) from error
    finally:
        os.close(descriptor)


def usb_of(device: str, sys: Path = Path("/sys")) -> str:
    """The USB version by which a video device is connected, such as 3.2; empty if not known.

    Args:
        device: A video device, or a link to one.
        sys: Where Linux tells of devices.
    """
    file = sys / "class" / "video4linux" / Path(device).resolve().name / "device" / ".." / "version"
    try:
        return file.read_text().strip()
    except OSError:
        return ""
