"""Base classes of cameras: the latest frame, its listener, a thread, and faults."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable

from duobench.core.backend import Image
from duobench.core.errors import BackendError
from duobench.real.clock import Clock, Ticker
from duobench.real.devices import Depth, Frame
from duobench.real.rig import CameraCalibration, CameraConfig
from duobench.results.labels import Fault, FaultKind

STALE_S = 0.7
"""Age of the latest frame at which its absence is a fault: later than what an episode waits for."""
FIRST_S = 10.0
"""Seconds in which the first frame has to come."""
JOIN_S = 3.0
"""Seconds that a thread has to end; one that waits for a camera that hangs is left behind."""


class LatestFrame(ABC):
    """The latest frame of a camera; frames come from one thread, questions from any.

    Messages name the camera, or its device where no name is given.
    """

    stale_s = STALE_S

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        name: str = "",
    ) -> None:
        self.config = config
        self.clock = clock
        self.name = name or config.device
        self.usb = ""
        """The USB version of its connection, such as 3.2; empty where it is not known."""
        self.lens: CameraCalibration | None = None
        """The manufacturer's lens, with no pose; None where it is not known."""
        self.trouble = ""
        """Last error, in words."""
        self._frame: Frame | None = None
        self._call: Callable[[Frame], None] | None = None
        self._connected_at: float | None = None  # since when a missing frame is a fault
        self._is_lost = False  # it could not be connected again

    @abstractmethod
    def connect(self) -> None:
        """Begin to take images; BackendError where that cannot be."""

    @abstractmethod
    def close(self) -> None:
        """Take no more images; closing twice is harmless."""

    def recover(self) -> None:
        """Connect again where something is wrong, or where that failed the last time."""
        if self.fault is not None or self._is_lost:
            self._is_lost = True
            self.close()
            self.connect()
            self._is_lost = False

    def latest(self) -> Frame | None:
        """The latest frame; None before the first one."""
        return self._frame

    def listen(self, call: Callable[[Frame], None] | None) -> None:
        """Give every frame from now on to a call, in the camera's thread; None ends it."""
        self._call = call

    @property
    def fault(self) -> Fault | None:
        """Fault of the camera, if any: no frame for too long."""
        if self._connected_at is None:
            return None
        since = self._connected_at if self._frame is None else self._frame.time_s
        age = self.clock.now() - since
        if age <= self.stale_s:
            return None
        why = f": {self.trouble}" if self.trouble else ""
        return FaultKind.COMMUNICATION.fault(
            f"The camera {self.name} has given no image for {age:.1f} s{why}."
        )

    def begin(self) -> None:
        """Treat a missing frame as a fault from now on, and forget earlier ones."""
        self._frame, self.trouble = None, ""
        self._connected_at = self.clock.now()

    def publish(
        self,
        image: Image,
        time_s: float,
        index: int,
        depth: Depth | None = None,
    ) -> None:
        """Take a frame, whose arguments are those of `Frame`, and give it to the listener."""
        height, width = self.config.size
        if image.shape != (height, width, 3):
            raise BackendError(
                f"The camera {self.name} gives images of {image.shape[1]}x{image.shape[0]}, and "
                f"the rig says {width}x{height}."
            )
        image.setflags(write=False)
        self._frame = frame = Frame(
            index=index, time_s=time_s, image=image, depth=depth
        )
        call = self._call
        if call is not None:
            call(frame)


class TickedCamera(LatestFrame):
    """A camera whose images a ticker of the clock takes; arguments are those of `LatestFrame`."""

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        name: str = "",
    ) -> None:
        super().__init__(config, clock, name)
        self._ticker: Ticker | None = None
        self._index = 0

    @abstractmethod
    def _image(self, index: int) -> Image | None:
        """Take the image of a number; None if it is lost. Raises BackendError without a camera."""

    def _depth(self) -> Depth | None:
        """The depth of the image that was taken last; None from a camera that measures none."""
        return None

    def connect(self) -> None:
        """Begin to take images; the first one decides whether they are as the rig says."""
        if self._ticker is not None:
            return
        self._index = 0
        self.begin()
        try:
            self._take()
        except BackendError:
            self.close()
            raise
        self._ticker = self.clock.every(
            1.0 / self.config.fps, self._tick, f"camera {self.name}"
        )

    def close(self) -> None:
        """Take no more images; closing twice is harmless."""
        self._connected_at = None
        if self._ticker is not None:
            self._ticker.stop()
            self._ticker = None

    def _take(self) -> None:
        image, index = self._image(self._index), self._index
        self._index += 1
        if image is not None:
            self.publish(image, self.clock.now(), index, self._depth())

    def _tick(self) -> None:
        try:
            self._take()
        except BackendError as error:
            self.trouble = str(error)


class ThreadedCamera(LatestFrame):
    """A camera that a thread of its own waits for; arguments are those of `LatestFrame`."""

    opening_s = 10.0

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        name: str = "",
    ) -> None:
        super().__init__(config, clock, name)
        self._thread: threading.Thread | None = None
        self._is_closing = threading.Event()
        self._has_begun = threading.Event()  # or failed to
        self._error: BackendError | None = None

    @abstractmethod
    def _open(self) -> None:
        """Open the camera, in its thread; BackendError where it cannot be opened."""

    @abstractmethod
    def _wait(self) -> tuple[Image, float, int, Depth | None] | None:
        """The next image with its time, number and depth; None after a short while without one.

        BackendError where there will be no more.
        """

    @abstractmethod
    def _shut(self) -> None:
        """Close the camera, in its thread; it may never have been opened."""

    def connect(self) -> None:
        """Open the camera and wait for its first image."""
        if self._thread is not None:
            return
        self._is_closing.clear()
        self._has_begun.clear()
        self._error = None
        name = f"camera {self.name}"
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()
        is_in_time = self._has_begun.wait(FIRST_S + self.opening_s)
        if self._error is not None or not is_in_time:
            self.close()
            raise self._error or BackendError(f"The camera {self.name} gives no image.")

    def close(self) -> None:
        """Let go of the camera; closing twice is harmless."""
        self._connected_at = None
        self._is_closing.set()
        if self._thread is not None and threading.current_thread() is not self._thread:
            self._thread.join(JOIN_S)
            self._thread = None

    def _run(self) -> None:
        try:
            self._open()
            self.begin()
            while not self._is_closing.is_set():
                news = self._wait()
                if news is not None:
                    self.publish(*news)
                    self._has_begun.set()
        except BackendError as error:
            self.trouble = str(error)
            self._error = error
        except Exception as error:  # noqa: BLE001 - the end of a thread; a fault tells of it
            self.trouble = f"{type(error).__name__}: {error}"
            self._error = BackendError(f"The camera {self.name} failed: {self.trouble}")
        finally:
            self._has_begun.set()
            self._shut()
