"""The subscriber that films an episode."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import gymnasium as gym
import numpy as np
from av.container import OutputContainer
from av.error import FFmpegError
from av.video.stream import VideoStream
from numpy.typing import NDArray

from duobench.errors import EvaluationError
from duobench.evaluation.files import replacing
from duobench.evaluation.loop import Info, Observation, Step
from duobench.types import CONTROL_HZ

FRAME_EVERY = 2
"""Control steps from one frame to the next; the video plays in real time."""
_CODEC = "libvpx-vp9"
"""VP9 in WebM: every current browser plays it, also those that come without licensed codecs."""
_CODEC_OPTIONS = {"deadline": "realtime", "cpu-used": "6", "crf": "33", "b": "0"}
_CONTAINER_OPTIONS = {"fflags": "+bitexact"}
"""No random identifiers in the file: the same frames, the same bytes."""

Image = NDArray[np.uint8]


class FilmError(EvaluationError):
    """A video cannot be written, through no fault of the policy."""


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, FFmpegError) as error:
        raise FilmError(
            f"A video cannot be written to {path.parent}: {error}. Make room, and give the same "
            "command again: it goes on where it stopped. With --videos 0 and another --out, none "
            "is made."
        ) from error


class Film:
    """Writes frames into an open video, one at the start and one every other control step."""

    def __init__(self, path: Path, render: Callable[[], Image]) -> None:
        """Remember where to write; the file is made with the first frame.

        Args:
            path: Where to write it.
            render: Gives the current picture, (height, width, 3), both even.
        """
        self._path = path
        self._render = render
        self._open: tuple[OutputContainer, VideoStream] | None = None
        self._shown = 0

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Film the reset."""
        self._add_frame()

    def on_step(self, step: Step) -> None:
        """Film every other step, and the last."""
        if step.number % FRAME_EVERY == 0 or step.terminated or step.truncated:
            self._add_frame()

    def on_episode_end(self) -> None:
        """Nothing is left to film."""

    def _add_frame(self) -> None:
        image = self._render()
        if self._open is None:
            with _writing(self._path):
                self._open = self._opened(image)
        container, stream = self._open
        frame = av.VideoFrame.from_ndarray(image, format="rgb24")
        frame.pts = self._shown
        self._shown += 1
        with _writing(self._path):
            container.mux(stream.encode(frame))

    def _opened(self, image: Image) -> tuple[OutputContainer, VideoStream]:
        container = av.open(self._path, "w", format="webm", options=_CONTAINER_OPTIONS)
        rate = Fraction(CONTROL_HZ) / FRAME_EVERY
        stream = container.add_stream(_CODEC, rate=rate, options=_CODEC_OPTIONS)
        stream.height, stream.width = image.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.thread_count = 1
        return container, stream

    def close(self) -> None:
        """Write what the encoder still holds and finish the file."""
        if self._open is not None:
            container, stream = self._open
            with _writing(self._path):
                container.mux(stream.encode())
                container.close()


@contextmanager
def filming(path: Path, render: Callable[[], Image]) -> Iterator[Film]:
    """A film that appears under its name once it is complete; none if nothing was filmed.

    Args:
        path: Where the video will be.
        render: Gives the current picture, (height, width, 3), both even.
    """
    with replacing(path) as temporary:
        film = Film(temporary, render)
        try:
            yield film
        finally:
            film.close()
