"""Intel RealSense D405 cameras, by pyrealsense2.

The colour of a D405 comes from its "Stereo Module": exposure and gain are set there. Depth, where
the rig asks for it, is brought to the pixels of the image. A camera may hang when a program has
ended badly; it is tried twice, and then reset. Recordings (.db3, .bag) are played in a camera's
place, which is how this was tried, and on no camera.
"""

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from duobench.core.backend import Image
from duobench.core.errors import BackendError
from duobench.core.machine import load_extra
from duobench.real.clock import Clock
from duobench.real.devices import Depth
from duobench.real.drivers.frames import ThreadedCamera
from duobench.real.rig import UNPOSED, CameraCalibration, CameraConfig

RECORDINGS = frozenset({".db3", ".bag"})
"""Endings of recordings, which are played in a camera's place."""
HANG_S = 4.0
"""Seconds without a first image after which a camera is taken to hang."""
ATTEMPTS = 3
"""Attempts to start a camera; before the last one it is reset."""
RESET_S = 15.0
"""Seconds in which a camera that was reset has to be back."""
WAIT_S = 0.5
NEEDED = "RealSense cameras need pyrealsense2 and the system's libusb-1.0-0"


class RealSenseCamera(ThreadedCamera):
    """A RealSense camera by its serial number, or a recording of one by its file."""

    opening_s = ATTEMPTS * HANG_S + RESET_S + 5.0

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        name: str = "",
    ) -> None:
        super().__init__(config, clock, name)
        self._library: Any = None
        self._pipeline: Any = None
        self._align: Any = (
            None  # depth to the pixels of the image, where it is measured
        )
        self._metres = 0.0  # of a unit of depth
        self._first: int | None = None
        self._is_recording = Path(config.device).suffix in RECORDINGS

    def _open(self) -> None:
        self._library = rs = load_extra(
            "pyrealsense2", "hardware", NEEDED, BackendError
        )
        device = self.config.device
        if self._is_recording and not Path(device).is_file():
            raise BackendError(f"There is no recording {device}.")
        if not self._is_recording and device not in (found := _devices(rs)):
            raise BackendError(
                f"There is no RealSense camera {device!r} for {self.name}; connected are: "
                f"{', '.join(found) or 'none'}."
            )
        for left in reversed(range(1 if self._is_recording else ATTEMPTS)):
            if left == 0 and not self._is_recording:
                self._reset()
            try:
                self._start(rs)
                return
            except RuntimeError as error:
                self._shut()
                if left == 0:
                    raise BackendError(
                        f"The camera {self.name} ({device}) gives no images: {error}. Plug it in "
                        "again, quickly, into a USB 3 port."
                    ) from error

    def _start(self, rs: Any) -> None:
        """Start its stream and wait until an image comes; RuntimeError where none does."""
        height, width = self.config.size
        wanted = rs.config()
        if self._is_recording:
            rs.config.enable_device_from_file(wanted, self.config.device, True)
        else:
            wanted.enable_device(self.config.device)
        wanted.enable_stream(
            rs.stream.color, width, height, rs.format.rgb8, self.config.fps
        )
        if self.config.depth:
            wanted.enable_stream(
                rs.stream.depth, width, height, rs.format.z16, self.config.fps
            )
        self._pipeline = rs.pipeline()
        profile = self._pipeline.start(wanted)
        device = profile.get_device()
        if not self._is_recording:
            self._lock_exposure(rs, device)
        if self.config.depth:
            self._align = rs.align(rs.stream.color)
            self._metres = device.first_depth_sensor().get_depth_scale()
        usb = rs.camera_info.usb_type_descriptor
        self.usb = device.get_info(usb) if device.supports(usb) else ""
        stream = profile.get_stream(rs.stream.color).as_video_stream_profile()
        self.lens = _lens(rs, stream.get_intrinsics())
        self._pipeline.wait_for_frames(round(HANG_S * 1000))
        self._first = None

    def _wait(self) -> tuple[Image, float, int, Depth | None] | None:
        rs = self._library
        has_come, frames = self._pipeline.try_wait_for_frames(round(WAIT_S * 1000))
        if not has_come:
            return None
        depth: Depth | None = None
        if self._align is not None:
            frames = self._align.process(frames)
            units = frames.get_depth_frame()
            if not units:
                return None
            depth = np.asarray(units.get_data()) * np.float32(self._metres)
        colour = frames.get_color_frame()
        if not colour:
            return None
        now, number = self.clock.now(), colour.get_frame_number()
        if self._first is None or number < self._first:  # a recording begins again
            self._first = number
        age = 0.0
        if colour.get_frame_timestamp_domain() != rs.timestamp_domain.hardware_clock:
            age = time.time() - colour.get_timestamp() / 1000.0
        time_s = now - age if 0.0 <= age <= WAIT_S else now
        latest = self.latest()
        index = number - self._first
        if latest is not None and index <= latest.index:
            index = latest.index + 1
            self._first = number - index
        return np.array(colour.get_data()), time_s, index, depth

    def _shut(self) -> None:
        if self._pipeline is not None:
            with suppress(RuntimeError):  # it was never started
                self._pipeline.stop()
            self._pipeline = None

    def _lock_exposure(self, rs: Any, device: Any) -> None:
        """Set what the rig says on the sensor that gives colour."""
        sensor = _colour_sensor(rs, device)
        config = self.config
        if config.exposure_us is None and config.gain is None:
            sensor.set_option(rs.option.enable_auto_exposure, 1)
            return
        sensor.set_option(rs.option.enable_auto_exposure, 0)
        wanted = {rs.option.exposure: config.exposure_us, rs.option.gain: config.gain}
        for option, value in wanted.items():
            if value is None:
                continue
            span = sensor.get_option_range(option)
            if not span.min <= value <= span.max:
                raise BackendError(
                    f"The camera {self.name} takes {option} of {span.min:g} to {span.max:g}, got "
                    f"{value:g}."
                )
            sensor.set_option(option, value)
        if sensor.supports(rs.option.enable_auto_white_balance):
            sensor.set_option(rs.option.enable_auto_white_balance, 0)

    def _reset(self) -> None:
        """Reset the camera as pulling its plug does, and wait until it is back."""
        rs, serial = self._library, self.config.device
        device = _devices(rs).get(serial)
        if device is None:
            return
        device.hardware_reset()
        end = time.monotonic() + RESET_S
        time.sleep(2.0)  # until then it is still listed
        while time.monotonic() < end and serial not in _devices(rs):
            time.sleep(0.5)


def _devices(rs: Any) -> dict[str, Any]:
    """The cameras that are connected, by serial number."""
    devices = rs.context().query_devices()
    return {device.get_info(rs.camera_info.serial_number): device for device in devices}


def _colour_sensor(rs: Any, device: Any) -> Any:
    for sensor in device.query_sensors():
        if any(
            each.stream_type() == rs.stream.color
            for each in sensor.get_stream_profiles()
        ):
            return sensor
    raise BackendError("The camera has no sensor that gives colour.")


def _lens(rs: Any, found: Any) -> CameraCalibration | None:
    """The factory's lens, where it has no distortion or one of OpenCV's kind."""
    coefficients = tuple(float(each) for each in found.coeffs)
    if any(coefficients) and found.model != rs.distortion.brown_conrady:
        return None
    return CameraCalibration(
        fx=found.fx,
        fy=found.fy,
        cx=found.ppx,
        cy=found.ppy,
        distortion=coefficients,
        pose=UNPOSED,
        method="factory",
    )
