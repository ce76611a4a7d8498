"""The driver of RealSense cameras, with a recording that the library itself makes and plays."""

from __future__ import annotations

import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import BackendError
from duobench.real.clock import SystemClock
from duobench.real.drivers.realsense import RealSenseCamera, _colour_sensor
from duobench.real.rig import CameraConfig

rs: Any = pytest.importorskip(
    "pyrealsense2",
    reason="It, or libusb-1.0-0, is not installed here: make test-hardware",
    exc_type=ImportError,
)

WIDTH, HEIGHT, COUNT = 1280, 720, 20
UNIT_M = 1e-4
"""A D405's unit of depth in metres."""


def video(profile: Any, number: int) -> Any:
    """A frame whose left half is red, brighter from frame to frame."""
    frame = rs.software_video_frame()
    frame.profile, frame.bpp, frame.stride = profile, 3, WIDTH * 3
    frame.timestamp, frame.frame_number = number * 1000 / 30, number + 1
    frame.domain = rs.timestamp_domain.hardware_clock
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[:, : WIDTH // 2, 0] = 10 * number
    frame.pixels = image
    return frame


def depth(profile: Any, number: int) -> Any:
    frame = rs.software_video_frame()
    frame.profile, frame.bpp, frame.stride = profile, 2, WIDTH * 2
    frame.timestamp, frame.frame_number = number * 1000 / 30, number + 1
    frame.domain = rs.timestamp_domain.hardware_clock
    frame.depth_units = UNIT_M
    image = np.full((HEIGHT, WIDTH), 3000, np.uint16)
    image[:, WIDTH // 2 :] = 5000
    image[:100] = 0
    frame.pixels = image.view(np.uint8).reshape(HEIGHT, 2 * WIDTH)
    return frame


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("realsense") / "d405.db3")


def recorded(path: Path, *, with_depth: bool = False) -> Path:
    """A recording of a D405 that is none; depth is 0.3 m, on the right 0.5 m, above none."""
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Intel RealSense D405")
    device.register_info(rs.camera_info.serial_number, "123622270000")
    device.register_info(rs.camera_info.usb_type_descriptor, "2.1")
    sensor = device.add_sensor("Stereo Module")
    lens = rs.intrinsics()
    lens.width, lens.height, lens.model = WIDTH, HEIGHT, rs.distortion.none
    lens.fx, lens.fy, lens.ppx, lens.ppy = 645.0, 644.0, 640.5, 361.0
    stream = rs.video_stream()
    stream.type, stream.fmt, stream.intrinsics = rs.stream.color, rs.format.rgb8, lens
    stream.width, stream.height, stream.fps, stream.bpp, stream.uid = WIDTH, HEIGHT, 30, 3, 0
    profile = sensor.add_video_stream(stream).as_video_stream_profile()
    deep = None
    if with_depth:
        stream.type, stream.fmt, stream.uid, stream.bpp = rs.stream.depth, rs.format.z16, 1, 2
        sensor.add_read_only_option(rs.option.depth_units, UNIT_M)
        deep = sensor.add_video_stream(stream).as_video_stream_profile()
        same = rs.extrinsics()
        same.rotation, same.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]
        deep.register_extrinsics_to(profile, same)
        profile.register_extrinsics_to(deep, same)
    recorder = rs.recorder(str(path), device)
    recorded = recorder.query_sensors()[0]
    recorded.open(recorded.get_stream_profiles())
    recorded.start(lambda _: None)
    for number in range(COUNT):
        sensor.on_video_frame(video(profile, number))
        if deep is not None:
            sensor.on_video_frame(depth(deep, number))
        time.sleep(0.01)
    time.sleep(0.5)
    recorded.stop()
    recorded.close()
    recorder.pause()
    del recorder
    return path


def camera_of(device: str, **options: Any) -> RealSenseCamera:
    config = CameraConfig(driver="realsense", device=device, **options)
    return RealSenseCamera(config, SystemClock(), "left_wrist")


def test_a_recording_is_played_with_what_the_camera_says(recording: Path) -> None:
    camera = camera_of(str(recording))
    camera.connect()
    seen: list[tuple[int, int]] = []
    camera.listen(lambda frame: seen.append((frame.index, int(frame.image[0, 0, 0]))))
    end = time.monotonic() + 60.0
    while len(seen) < 2 * COUNT and time.monotonic() < end:
        time.sleep(0.01)
    camera.close()
    camera.close()
    assert len(seen) >= 2 * COUNT, "a recording is played again and again"
    assert all(later[0] > earlier[0] for earlier, later in pairwise(seen))
    assert len({value for _, value in seen}) > COUNT / 2
    assert camera.usb == "2.1"
    assert camera.lens is not None
    assert (camera.lens.fx, camera.lens.cx) == (645.0, 640.5)
    assert not any(camera.lens.distortion)


def test_depth_is_given_in_metres_at_the_pixels_of_the_image(tmp_path: Path) -> None:
    path = recorded(tmp_path / "deep.db3", with_depth=True)
    camera = camera_of(str(path), depth=True)
    camera.connect()
    frame = camera.latest()
    camera.close()
    assert frame is not None
    assert frame.depth is not None
    assert (frame.depth.dtype, frame.depth.shape) == (np.float32, (HEIGHT, WIDTH))
    parts = (slice(20, 620), 0.3), (slice(660, 1260), 0.5)
    for columns, expected in parts:
        found = frame.depth[120:700, columns]
        seen = found > 0.0
        assert seen.mean() > 0.9  # the library leaves holes where it rounds
        np.testing.assert_allclose(found[seen], expected, rtol=1e-6)
    assert not frame.depth[:90].any()
    plain = camera_of(str(path))
    plain.connect()
    frame = plain.latest()
    plain.close()
    assert frame is not None
    assert frame.depth is None


def test_colour_comes_from_the_stereo_module(recording: Path) -> None:
    wanted = rs.config()
    rs.config.enable_device_from_file(wanted, str(recording), True)
    pipeline = rs.pipeline()
    device = pipeline.start(wanted).get_device()
    name = _colour_sensor(rs, device).get_info(rs.camera_info.name)
    pipeline.stop()
    assert name == "Stereo Module"


def test_what_is_missing_or_of_another_size_is_named(recording: Path) -> None:
    small, flat = (
        camera_of(str(recording), **given) for given in ({"size": (480, 640)}, {"depth": True})
    )
    missing, none = camera_of(str(recording.with_name("none.db3"))), camera_of("1234")
    for camera, words in (
        (small, "gives no images"),
        (flat, "gives no images"),
        (missing, "There is no recording"),
        (none, "no RealSense camera '1234' for left_wrist"),
    ):
        with pytest.raises(BackendError, match=words):
            camera.connect()
