"""Cameras that Linux knows as video devices, and films played in their place, both by PyAV.

A ZED Mini is such a device: it gives both lenses side by side, of which the left one is kept.
Tried with files and generated images, and on no camera.
"""

import fcntl
import os
import struct
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.error import FFmpegError

from duobench.core.backend import Image
from duobench.core.errors import BackendError
from duobench.real.clock import Clock
from duobench.real.drivers.frames import ThreadedCamera, TickedCamera
from duobench.real.rig import CameraConfig

GENERATED = "lavfi:"
"""Begins a device that FFmpeg generates: lavfi:testsrc2=size=1280x720:rate=30."""
MOST_DELAY_S = 1.0
"""Most seconds between the time of a frame and its arrival, if both are of one clock."""
_SET = 0xC008561C
"""VIDIOC_S_CTRL of <linux/videodev2.h>: an identifier and a value of 32 bits each."""
_EXPOSURE_MODE, _EXPOSURE, _WHITE_BALANCE, _GAIN = (
    0x009A0901,
    0x009A0902,
    0x0098090C,
    0x00980913,
)
_MANUAL = 1
_EXPOSURE_UNIT_US = 100.0


class UvcCamera(ThreadedCamera):
    """A video device by its file, best one of /dev/v4l/by-id/."""

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        name: str = "",
    ) -> None:
        super().__init__(config, clock, name)
        self._container: Any = None
        self._frames: Iterator[Any] = iter(())
        self._last: tuple[int, float] | None = None

    def _open(self) -> None:
        config, device = self.config, self.config.device
        lock_exposure(device, config.exposure_us, config.gain)
        height, width = config.size
        options = {
            "video_size": f"{width * (2 if config.is_side_by_side else 1)}x{height}",
            "framerate": str(config.fps),
            "input_format": "yuyv422",
        }
        self._container = opened(self.name, device, "v4l2", options)
        self._frames = self._container.decode(video=0)
        self._last = None
        self.usb = usb_of(device)

    def _wait(self) -> tuple[Image, float, int, None]:
        try:
            frame = next(self._frames)
        except (FFmpegError, StopIteration) as error:
            raise BackendError(
                f"{self.config.device} gives no more images ({error})"
            ) from error
        now = self.clock.now()
        taken = None if frame.time is None else float(frame.time)
        is_dated = taken is not None and 0.0 <= now - taken <= MOST_DELAY_S
        time_s = taken if is_dated and taken is not None else now
        index = 0
        if self._last is not None:
            passed = (
                round((time_s - self._last[1]) * self.config.fps) if is_dated else 1
            )
            index = self._last[0] + max(1, passed)
        self._last = index, time_s
        image = pixels(frame, is_side_by_side=self.config.is_side_by_side)
        return image, time_s, index, None

    def _shut(self) -> None:
        if self._container is not None:
            self._container.close()
            self._container = None


class FileCamera(TickedCamera):
    """Camera that loops a video, an image or a generated FFmpeg source at its rate.

    `config.device` is the file, or begins with `lavfi:`.
    """

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        name: str = "",
    ) -> None:
        super().__init__(config, clock, name)
        self._images = self._play()

    def close(self) -> None:
        """Close the file; closing twice is harmless."""
        super().close()
        self._images.close()
        self._images = self._play()

    def _image(self, index: int) -> Image:  # noqa: ARG002 - a file has an order of its own
        try:
            return next(self._images)
        except BackendError:
            self._images = self._play()  # try again
            raise

    def _play(self) -> Generator[Image, None, None]:
        """Yield all images in a loop; a single image is decoded once."""
        device = self.config.device
        is_side_by_side = self.config.is_side_by_side
        kind = "lavfi" if device.startswith(GENERATED) else None
        while True:
            image = None
            count = 0
            with opened(self.name, device.removeprefix(GENERATED), kind) as container:
                try:
                    for frame in container.decode(video=0):
                        image = pixels(frame, is_side_by_side=is_side_by_side)
                        count += 1
                        yield image
                except FFmpegError as error:
                    raise BackendError(
                        f"{device} cannot be decoded: {error}"
                    ) from error
            if image is None:
                raise BackendError(f"{device} holds no images.")
            while count == 1:
                yield image


def opened(
    name: str, device: str, kind: str | None, options: dict[str, str] | None = None
) -> Any:
    """A container of PyAV with a stream of images."""
    try:
        container = av.open(device, format=kind, options=options or {})
    except (FFmpegError, ValueError) as error:
        raise BackendError(
            f"The camera {name} cannot be opened at {device!r}: {error}"
        ) from error
    if not container.streams.video:
        container.close()
        raise BackendError(f"{device} of the camera {name} holds no images.")
    return container


def pixels(frame: Any, *, is_side_by_side: bool) -> Image:
    """Red, green, blue (height, width, 3) of a decoded frame; the left half of two lenses."""
    image = frame.to_ndarray(format="rgb24")
    if is_side_by_side:
        image = image[:, : image.shape[1] // 2]
    return np.ascontiguousarray(image)


def lock_exposure(
    device: str,
    exposure_us: float | None,
    gain: float | None,
) -> None:
    """Set what is given, and keep the camera from changing it and its white balance.

    Exposure is in microseconds, in steps of 100, and gain in the camera's units; None leaves one
    alone.
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


def usb_of(device: str) -> str:
    """The USB version by which a video device, or a link to one, is connected; empty if unknown."""
    name = Path(device).resolve().name
    try:
        return (
            Path(f"/sys/class/video4linux/{name}/device/../version").read_text().strip()
        )
    except OSError:
        return ""
