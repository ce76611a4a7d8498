"""What the head camera sees, and the film of a trial, to look at now and before it is closed.

Encoding happens in a thread of its own, so that no control step waits for it.
"""

from __future__ import annotations

import io
import queue
import threading
from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING

from duobench.backend import Image
from duobench.errors import BackendError, RenderingError, VideoError
from duobench.hardware.duo import HardwareDuo
from duobench.rig_sessions.overlay import jpeg
from duobench.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from duobench.types import CONTROL_HZ, HEAD
from duobench.video import VP9, VideoWriter

if TYPE_CHECKING:
    import gymnasium as gym

    from duobench.evaluation.rollout import Info, Observation, Step

NATIVE = NATIVE_HEIGHT, NATIVE_WIDTH
"""Height and width of the camera's own images."""
FILM_EVERY = 3
"""Control steps from one frame to the next."""
FILM_SIZE = (360, 640)
"""Height and width of a frame in pixels."""
FILM_RATE = Fraction(CONTROL_HZ) / FILM_EVERY
"""Frames a second: the film plays in real time, and frame n shows control step n times
`FILM_EVERY`."""
_WAITING = 64
"""Frames that wait for the encoder at most; six seconds."""


class HeadCamera:
    """The head camera of a rig that may have none."""

    def __init__(self, duo: HardwareDuo) -> None:
        """Look through the camera of a rig."""
        self._duo = duo

    def image(self, shape: tuple[int, int]) -> Image | None:
        """The latest image, as the simulation's camera would have taken it.

        Args:
            shape: Height and width in pixels.

        Returns:
            The image (height, width, 3); None if there is no camera, or it gives nothing.
        """
        if HEAD not in self._duo.cameras:
            return None
        try:
            return self._duo.images((HEAD,), shape)[HEAD]
        except (BackendError, RenderingError):
            return None


class Film:
    """A watcher that films an episode."""

    def __init__(
        self, look: Callable[[tuple[int, int]], Image | None], show: Callable[[bytes], None]
    ) -> None:
        """Begin a film.

        Args:
            look: Gives the head camera's image of a height and width; None if there is no camera.
            show: Takes every frame as JPEG, in the film's thread.
        """
        self._look, self._show = look, show
        self._file = io.BytesIO()
        self._frames: queue.Queue[Image | None] = queue.Queue(_WAITING)
        self._error: VideoError | None = None
        self._thread = threading.Thread(target=self._encode, name="film", daemon=True)
        self._thread.start()

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Film the start."""
        self._add()

    def on_step(self, step: Step) -> None:
        """Film every third step."""
        if step.number % FILM_EVERY == 0:
            self._add()

    def on_episode_end(self, error: BaseException | None) -> None:  # noqa: ARG002 - what there was is shown
        """Finish the film, whatever the end was."""
        if self._thread.is_alive():
            self._frames.put(None)
            self._thread.join()

    def video(self) -> bytes | None:
        """The film as WebM, once it is finished; None without a frame, or if it failed."""
        return None if self._error else self._file.getvalue() or None

    def _add(self) -> None:
        image = self._look(FILM_SIZE)
        if image is not None:
            self._frames.put(image)

    def _encode(self) -> None:
        writer = VideoWriter(self._file, VP9, FILM_RATE)
        while (image := self._frames.get()) is not None:
            self._show(jpeg(image))
            if self._error is None:
                try:
                    writer.add(image)
                except VideoError as error:
                    self._error = error
        try:
            writer.close()
        except VideoError as error:
            self._error = error
