"""The driver of RealSense cameras with a library that is none: exposure, retries, the reset."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from duobench.core.errors import BackendError
from duobench.real.clock import VirtualClock
from duobench.real.drivers import realsense
from duobench.real.drivers.realsense import ATTEMPTS, RealSenseCamera
from duobench.real.rig import CameraConfig, CameraDriver

SERIAL = "123622270000"
SPANS = {"exposure": (1, 165000), "gain": (16, 248)}


@dataclass
class Sensor:
    stream: str
    options: dict[str, float] = field(default_factory=dict[str, float])

    def get_stream_profiles(self) -> list[Any]:
        return [SimpleNamespace(stream_type=lambda: self.stream)]

    def set_option(self, option: str, value: float) -> None:
        self.options[option] = value

    def get_option_range(self, option: str) -> Any:
        low, high = SPANS[option]
        return SimpleNamespace(min=low, max=high)

    def supports(self, option: str) -> bool:
        return option == "enable_auto_white_balance"


class Library:
    """What the driver calls of `pyrealsense2`, with one camera that hangs as often as told."""

    stream = SimpleNamespace(color="color")
    format = SimpleNamespace(rgb8="rgb8")
    distortion = SimpleNamespace(brown_conrady="brown_conrady")
    camera_info = SimpleNamespace(serial_number="serial", usb_type_descriptor="usb")
    option = SimpleNamespace(
        exposure="exposure",
        gain="gain",
        enable_auto_exposure="enable_auto_exposure",
        enable_auto_white_balance="enable_auto_white_balance",
    )

    def __init__(self) -> None:
        self.hangs = 0
        self.log: list[str] = []
        self.depth, self.colour = Sensor("depth"), Sensor("color")
        facts = {"serial": SERIAL, "usb": "3.2"}
        self.device = SimpleNamespace(
            query_sensors=lambda: [self.depth, self.colour],
            supports=lambda fact: fact in facts,
            get_info=facts.get,
            hardware_reset=lambda: self.log.append("reset"),
        )

    def context(self) -> Any:
        return SimpleNamespace(query_devices=lambda: [self.device])

    def config(self) -> Any:
        return SimpleNamespace(
            enable_device=lambda serial: self.log.append(f"device {serial}"),
            enable_stream=lambda *wanted: self.log.append(f"stream {wanted}"),
        )

    def pipeline(self) -> Any:
        lens = SimpleNamespace(coeffs=[0.0] * 5, model="", fx=645.0, fy=644.0, ppx=640.0, ppy=360.0)
        stream = SimpleNamespace(get_intrinsics=lambda: lens)
        typed = SimpleNamespace(as_video_stream_profile=lambda: stream)
        profile = SimpleNamespace(get_device=lambda: self.device, get_stream=lambda _: typed)
        return SimpleNamespace(
            start=lambda _: profile,
            wait_for_frames=self.wait_for_frames,
            stop=lambda: self.log.append("stop"),
        )

    def wait_for_frames(self, _milliseconds: int) -> None:
        self.log.append("wait")
        self.hangs -= 1
        if self.hangs >= 0:
            raise RuntimeError("Frame didn't arrive within 4000")


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Library:
    made = Library()
    monkeypatch.setitem(sys.modules, "pyrealsense2", made)  # type: ignore[arg-type]
    monkeypatch.setattr(realsense.time, "sleep", lambda _: None)
    return made


def opened(device: str = SERIAL, **options: Any) -> RealSenseCamera:
    config = CameraConfig(driver=CameraDriver.REALSENSE, device=device, **options)
    camera = RealSenseCamera(config, VirtualClock(), "left_wrist")
    camera._open()
    return camera


def test_exposure_and_gain_are_locked_on_the_sensor_of_colour(library: Library) -> None:
    camera = opened(exposure_us=8000.0, gain=32.0)
    assert library.colour.options == {
        "enable_auto_exposure": 0,
        "exposure": 8000.0,
        "gain": 32.0,
        "enable_auto_white_balance": 0,
    }
    assert library.depth.options == {}
    assert f"device {SERIAL}" in library.log
    assert camera.usb == "3.2"


def test_a_rig_that_says_nothing_lets_the_camera_choose(library: Library) -> None:
    opened()
    assert library.colour.options == {"enable_auto_exposure": 1}


@pytest.mark.usefixtures("library")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"exposure_us": 200000.0, "fps": 5}, r"exposure of 1 to 165000, got 200000"),
        ({"device": "42"}, f"connected are: {SERIAL}"),
    ],
)
def test_what_the_camera_is_not_or_does_not_take_is_told(
    options: dict[str, Any], words: str
) -> None:
    with pytest.raises(BackendError, match=words):
        opened(**options)


@pytest.mark.parametrize("hangs", range(ATTEMPTS))
def test_a_camera_that_hangs_is_tried_again_and_then_reset(library: Library, hangs: int) -> None:
    library.hangs = hangs
    opened()
    steps = [word for word in library.log if word in {"wait", "stop", "reset"}]
    expected = ["wait", "stop"] * hangs + ["wait"]
    if hangs == ATTEMPTS - 1:
        expected.insert(-1, "reset")
    assert steps == expected


def test_a_camera_that_goes_on_hanging_is_told(library: Library) -> None:
    library.hangs = ATTEMPTS
    with pytest.raises(BackendError, match=r"left_wrist .* gives no images"):
        opened()
    assert library.log.count("reset") == 1
    assert library.log[-1] == "stop"
