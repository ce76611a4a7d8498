"""The watcher that makes a video of an episode."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from fractions import Fraction

import av
import gymnasium as gym
import numpy as np
from av.container import OutputContainer
from av.error import FFmpegError
from av.video.stream import VideoStream
from numpy.typing import NDArray

from duobench.errors import MachineryError
from duobench.evaluation.rollout import Info, Observation, Step
from duobench.types import CONTROL_HZ

FRAME_EVERY = 2
"""Control steps from one frame to the next; the video plays in real time."""
_CODEC = "libvpx-vp9"
"""VP9 in WebM: every current browser plays it, also those that come without licensed codecs."""
_CODEC_OPTIONS = {"deadline": "realtime", "cpu-used": "6", "crf": "33", "b": "0"}
_CONTAINER_OPTIONS = {"fflags": "+bitexact"}
"""No random identifiers in the file: the same frames, the same bytes."""

Image = NDArray[np.uint8]


@contextmanager
def _encoding() -> Iterator[None]:
    try:
        yield
    except FFmpegError as error:
        raise MachineryError(f"A video cannot be encoded: {error}.") from error


def encode_video(images: Iterable[Image]) -> bytes | None:
    """A WebM video of images (height, width, 3), both even, that are `FRAME_EVERY` steps apart.

    Raises:
        MachineryError: They cannot be encoded.
    """
    recorder = VideoRecorder(lambda: np.empty(0, np.uint8))
    for image in images:
        recorder.add(image)
    recorder.on_episode_end(None)
    return recorder.video()


class VideoRecorder:
    """Encodes a video in memory: a frame at the start, and one every other control step.

    A video of an episode is half a megabyte, so it needs no file until it is complete.
    """

    def __init__(self, render: Callable[[], Image]) -> None:
        """Remember what to show; encoding begins with the first frame.

        Args:
            render: Gives the current image, (height, width, 3), both even.
        """
        self._render = render
        self._file = io.BytesIO()
        self._open: tuple[OutputContainer, VideoStream] | None = None
        self._frames = 0

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Show the reset."""
        self.add(self._render())

    def on_step(self, step: Step) -> None:
        """Show every other step, and the last."""
        if step.number % FRAME_EVERY == 0 or step.terminated or step.truncated:
            self.add(self._render())

    def on_episode_end(self, error: BaseException | None) -> None:  # noqa: ARG002 - what there was is shown
        """Finish the video, whatever the end was."""
        if self._open is not None:
            container, stream = self._open
            with _encoding():
                container.mux(stream.encode())
                container.close()

    def video(self) -> bytes | None:
        """The video as a WebM file, once the episode has ended; None if nothing was shown."""
        return self._file.getvalue() if self._frames else None

    def add(self, image: Image) -> None:
        """Add a frame (height, width, 3), both even."""
        with _encoding():
            self._open = self._open or self._opened(image)
            container, stream = self._open
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts = self._frames
            self._frames += 1
            container.mux(stream.encode(frame))

    def _opened(self, image: Image) -> tuple[OutputContainer, VideoStream]:
        container = av.open(self._file, "w", format="webm", options=_CONTAINER_OPTIONS)
        rate = Fraction(CONTROL_HZ) / FRAME_EVERY
        stream = container.add_stream(_CODEC, rate=rate, options=_CODEC_OPTIONS)
        stream.height, stream.width = image.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.thread_count = 1
        return container, stream
