"""Images of a rig's cameras for people: live images, films of episodes, views for exports.

Images are encoded in threads of their own, so that no control step waits for it.
"""

import io
import logging
import math
import queue
import threading
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import Any

import gymnasium as gym

from duobench.core.backend import Image
from duobench.core.codecs import VP9
from duobench.core.errors import BackendError, RenderingError, VideoError
from duobench.core.types import CONTROL_HZ
from duobench.core.video import VideoWriter, jpeg
from duobench.evaluation.rollouts import Info, Observation, Step
from duobench.real.canonical import NATIVE
from duobench.real.clock import SystemClock
from duobench.real.devices import Frame, image_ages
from duobench.real.drivers.frames import STALE_S
from duobench.real.duo import FrankaDuo
from duobench.web.server import PageServer
from duobench.world.robot.cameras import HEAD

_log = logging.getLogger(__name__)

FILM_EVERY = 3
"""Control steps from one frame to the next."""
FILM_SIZE = (360, 640)
"""Height and width of a frame in pixels."""
FILM_RATE = Fraction(CONTROL_HZ) / FILM_EVERY
"""Frames a second: the film plays in real time, and frame n shows control step n times
`FILM_EVERY`."""
PERIOD_S = 0.1
"""Seconds from one look at the cameras to the next."""
SHOWN_WIDTH = 640
"""Width in pixels of a feed; wider images are made smaller by a whole number."""
_WAITING = 64
"""Frames that wait for the encoder at most; six seconds."""


def head_image(duo: FrankaDuo, shape: tuple[int, int] = NATIVE) -> Image | None:
    """The latest image of a rig's head camera, as the simulation's camera would have taken it.

    It has a shape of height and width in pixels; None if there is no camera, or it gives nothing.
    """
    if HEAD not in duo.cameras:
        return None
    try:
        return duo.images((HEAD,), shape)[HEAD]
    except (BackendError, RenderingError):
        return None


class Film:
    """A watcher that films an episode with the head camera, if there is one.

    No control step waits for it: a frame that the encoder has no time for is lost, and the one
    before is shown in its place, so that each frame stays at its control step.

    Args:
        duo: The rig.
        show: Takes every frame as JPEG, in the film's thread.
    """

    def __init__(self, duo: FrankaDuo, show: Callable[[bytes], None]) -> None:
        self._duo, self._show = duo, show
        self._file = io.BytesIO()
        self._frames: queue.Queue[tuple[int, Image] | None] = queue.Queue(_WAITING)
        self._error: VideoError | None = None
        self.lost = 0
        """Frames that the encoder had no time for."""
        self._thread = threading.Thread(target=self._encode, name="film", daemon=True)
        self._thread.start()

    def on_episode_start(
        self,
        env: gym.Env,  # noqa: ARG002 - the protocol's signature
        observation: Observation,  # noqa: ARG002 - the protocol's signature
        info: Info,  # noqa: ARG002
    ) -> None:
        """Film the start."""
        self._add(0)

    def on_step(self, step: Step) -> None:
        """Film every third step."""
        if step.number % FILM_EVERY == 0:
            self._add(step.number // FILM_EVERY)

    def on_episode_end(self, error: BaseException | None) -> None:  # noqa: ARG002 - what there was is shown
        """Finish the film, however the episode ended."""
        if self._thread.is_alive():
            self._frames.put(None)
            self._thread.join()
        if self.lost:
            _log.warning(
                "%d frames of the film are missing: this computer was busy.", self.lost
            )

    def video(self) -> bytes | None:
        """The film as WebM, once it is finished; None without a frame, or if it failed."""
        return None if self._error else self._file.getvalue() or None

    def _add(self, number: int) -> None:
        image = head_image(self._duo, FILM_SIZE)
        if image is None:
            return
        try:
            self._frames.put_nowait((number, image))
        except queue.Full:
            self.lost += 1

    def _encode(self) -> None:
        writer = VideoWriter(self._file, VP9, FILM_RATE)
        written = 0
        before = None
        is_shown = True
        while (frame := self._frames.get()) is not None:
            number, image = frame
            try:
                if is_shown:
                    self._show(jpeg(image))
            except Exception:  # noqa: BLE001 - pictures for people end no film
                _log.exception("What is filmed cannot be shown.")
                is_shown = False
            for shown in (
                *[image if before is None else before] * (number - written),
                image,
            ):
                if self._error is None:
                    self._try(partial(writer.add, shown))
            written, before = number + 1, image
        self._try(writer.close)

    def _try(self, act: Callable[[], None]) -> None:
        try:
            act()
        except VideoError as error:
            self._error = error


class CameraFeed:
    """Shows a page the newest image of each camera, as it came from it, and how old it is.

    Only with a visitor, and also while the loop that leads the arms waits for the operator. A
    camera that gives nothing new costs nothing, and the page says how old its image is. The rig may
    be connected later.
    """

    def __init__(self, duo: FrankaDuo, server: PageServer) -> None:
        self._duo, self._server = duo, server
        self._shown: dict[
            str, tuple[Frame, str]
        ] = {}  # what each camera's address shows
        self._ticker = SystemClock().every(PERIOD_S, self._tick, "cameras of the page")

    def close(self) -> None:
        """Look no more; closing twice is harmless."""
        self._ticker.stop()

    def look(self) -> None:
        """Publish what is new, and say how old each image is."""
        for name, frame in self._duo.frames().items():
            before = self._shown.get(name)
            if before is None or before[0] is not frame:
                content = jpeg(frame.image, SHOWN_WIDTH)
                self._shown[name] = (
                    frame,
                    self._server.publish_image(f"camera-{name}", content),
                )
        ages = image_ages(self._duo.cameras, self._duo.clock.now())
        self._server.publish_cameras([self._about(*each) for each in ages.items()])

    def _about(self, name: str, age_s: float) -> dict[str, Any]:
        frame, address = self._shown.get(name, (None, ""))
        is_stale = frame is not None and age_s > STALE_S
        return {
            "name": name,
            "title": f"{name.replace('_', ' ').capitalize()} camera",
            "image": address,
            "number": None if frame is None else frame.index,
            "stale_s": round(age_s, 1) if is_stale and math.isfinite(age_s) else None,
        }

    def _tick(self) -> None:
        try:
            if self._server.has_viewers:
                self.look()
        except Exception:  # noqa: BLE001 - pictures for people end no session
            _log.exception("What the cameras see cannot be shown.")
            self._ticker.stop()
