"""Cameras behind PyAV, with generated images and files."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from duobench.core.errors import BackendError
from duobench.real.clock import SystemClock, VirtualClock
from duobench.real.devices import Frame
from duobench.real.drivers import uvc
from duobench.real.drivers.frames import ThreadedCamera
from duobench.real.drivers.uvc import FileCamera, UvcCamera, lock_exposure
from duobench.real.opening import open_rig
from duobench.real.rig import CameraConfig
from duobench.results.labels import FaultKind
from tests.real.simulated import simulated_rig
from tests.web.pages import wait_until

COUNT = 12


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames of two lenses: the left one grows brighter, the right one is blue."""
    path = tmp_path_factory.mktemp("film") / "zed.mkv"
    with av.open(path, "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = 2560, 720, "bgr0"
        for number in range(COUNT):
            image = np.zeros((720, 2560, 3), np.uint8)
            image[:, :1280] = 20 * number
            image[:, 1280:, 2] = 255
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())
    return path


def config_of(device: str, **options: object) -> CameraConfig:
    return CameraConfig(driver="file", device=device, **options)  # type: ignore[arg-type]


def test_the_left_lens_is_played_again_and_again(film: Path) -> None:
    clock, seen = VirtualClock(), []
    camera = FileCamera(config_of(str(film), is_side_by_side=True), clock, "head")
    assert camera.latest() is None
    camera.connect()
    camera.listen(seen.append)
    clock.wait_until(0.9 + 1e-9)
    camera.listen(None)
    clock.wait_until(1.0)
    camera.close()
    camera.close()
    numbers = np.arange(1, 28)
    assert [frame.index for frame in seen] == numbers.tolist()
    np.testing.assert_allclose([frame.time_s for frame in seen], numbers / 30)
    for frame in seen:
        assert frame.image.shape == (720, 1280, 3)
        assert (frame.image == 20 * (frame.index % COUNT)).all()
    with pytest.raises(ValueError, match="read-only"):
        seen[0].image[0, 0, 0] = 1


@pytest.mark.parametrize(
    ("device", "fps"), [("lavfi:testsrc2=size=1280x720:rate=15", 15), ("still.png", 30)]
)
def test_generated_and_still_images_come_at_the_rate_of_the_camera(
    device: str, fps: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Image.fromarray(np.full((720, 1280, 3), 77, np.uint8)).save("still.png")
    clock = VirtualClock()
    camera = FileCamera(config_of(device, fps=fps), clock, "head")
    camera.connect()
    clock.wait_until(1.0 + 1e-9)
    frame = camera.latest()
    assert camera.fault is None
    camera.close()
    assert frame is not None
    assert frame.index == fps
    assert device != "still.png" or (frame.image == 77).all()


@pytest.mark.parametrize(
    ("device", "options", "complaint"),
    [
        ("nowhere.mkv", {}, "camera head cannot be opened at 'nowhere.mkv'"),
        ("lavfi:nothing=1", {}, "cannot be opened"),
        ("lavfi:sine=frequency=440", {}, "holds no images"),
        ("lavfi:testsrc2=size=640x480", {}, "gives images of 640x480, and the rig says 1280x720"),
    ],
)
def test_what_is_no_film_of_the_size_is_refused(
    device: str, options: dict[str, object], complaint: str
) -> None:
    clock = VirtualClock()
    camera = FileCamera(config_of(device, **options), clock, "head")
    with pytest.raises(BackendError, match=complaint):
        camera.connect()
    assert camera.fault is None
    clock.wait_until(1.0)
    camera.close()


def test_a_film_that_vanishes_becomes_a_fault(film: Path, tmp_path: Path) -> None:
    clock, copy = VirtualClock(), tmp_path / "film.mkv"
    copy.write_bytes(film.read_bytes())
    camera = FileCamera(config_of(str(copy), is_side_by_side=True), clock, "head")
    camera.connect()
    copy.unlink()
    clock.wait_until(COUNT / 30 + 0.6)
    assert camera.fault is None
    clock.wait_until(COUNT / 30 + 0.9)
    fault = camera.fault
    camera.close()
    assert fault is not None
    assert fault.kind is FaultKind.COMMUNICATION
    assert "has given no image for 0.9 s: The camera head cannot be opened" in fault.text


@pytest.mark.parametrize(
    ("device", "exposure_us", "gain", "complaint"),
    [
        ("/dev/video_none", None, None, "camera head cannot be opened at '/dev/video_none'"),
        ("/dev/null", None, None, "camera head cannot be opened at '/dev/null'"),
        ("/dev/null", 5000.0, None, "/dev/null does not take manual exposure 1"),
        ("/dev/null", None, 16.0, "/dev/null does not take gain 16"),
    ],
)
def test_what_a_video_device_is_not_or_does_not_take_is_named(
    device: str, exposure_us: float | None, gain: float | None, complaint: str
) -> None:
    config = config_of(device, exposure_us=exposure_us, gain=gain)
    camera = UvcCamera(config, SystemClock(), "head")
    with pytest.raises(BackendError, match=complaint):
        camera.connect()
    camera.close()


def test_exposure_is_set_by_the_controls_of_linux(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Identifiers of <linux/v4l2-controls.h>; exposure in units of 100 µs."""
    device = tmp_path / "video0"
    device.touch()
    said: list[tuple[int, int]] = []
    monkeypatch.setattr(
        uvc.fcntl, "ioctl", lambda _file, _request, data: said.append(struct.unpack("=Ii", data))
    )
    lock_exposure(str(device), 8000.0, 16.0)
    auto_exposure, absolute_exposure = 0x009A0901, 0x009A0902
    auto_white_balance, gain, manual = 0x0098090C, 0x00980913, 1
    expected = {auto_exposure: manual, absolute_exposure: 80, auto_white_balance: 0, gain: 16}
    assert said == [*expected.items()]


class Numbers(ThreadedCamera):
    """A camera whose images are computed; it may hang, or fail."""

    hangs = False
    fails = ""

    def _open(self) -> None:
        self._count = -1

    def _wait(self) -> tuple[np.ndarray, float, int] | None:
        time.sleep(0.002)
        if self.fails:
            raise BackendError(self.fails)
        if self.hangs:
            return None
        self._count += 1
        return np.zeros((*self.config.size, 3), np.uint8), self.clock.now(), self._count

    def _shut(self) -> None:
        pass


def wait_for_fault(camera: ThreadedCamera) -> str:
    wait_until(lambda: camera.fault is not None)
    assert camera.fault is not None
    return camera.fault.text


@pytest.fixture
def camera() -> Iterator[Numbers]:
    made = Numbers(config_of("", size=(90, 160)), SystemClock(), "head")
    made.connect()
    yield made
    made.close()


def test_a_thread_waits_for_images(camera: Numbers) -> None:
    first = camera.latest()
    assert first is not None

    def goes_on() -> bool:
        frame = camera.latest()
        return frame is not None and frame.index >= first.index + 5

    wait_until(goes_on)
    camera.hangs = True
    assert "has given no image for" in wait_for_fault(camera)
    camera.close()
    assert camera.fault is None


def test_a_camera_that_fails_says_why(camera: Numbers) -> None:
    camera.fails = "the plug was pulled"
    assert "the plug was pulled" in wait_for_fault(camera)
    camera.close()
    with pytest.raises(BackendError, match="the plug was pulled"):
        camera.connect()
    camera.fails = ""
    camera.connect()
    assert camera.latest() is not None


def test_a_camera_that_was_unplugged_comes_back_once_the_operator_recovers(camera: Numbers) -> None:
    with closing(open_rig(simulated_rig(), SystemClock(), guard=False)) as duo:
        duo.cameras["head"] = camera
        duo.start()
        camera.fails = "the plug was pulled"
        wait_for_fault(camera)
        wait_until(lambda: duo.fault is not None)
        for _ in range(2):  # it stays wrong as long as nothing was done
            with pytest.raises(BackendError, match="the plug was pulled"):
                duo.supervisor.recover()
            assert duo.fault is not None
        camera.fails = ""
        duo.supervisor.recover()
        assert duo.fault is None
        assert duo.frames()["head"].image.shape == (90, 160, 3)


def test_a_listener_that_raises_becomes_a_fault(camera: Numbers) -> None:
    def fail(frame: Frame) -> None:
        raise ValueError(f"the disk is full at {frame.index}")

    camera.listen(fail)
    assert "ValueError: the disk is full at" in wait_for_fault(camera)
