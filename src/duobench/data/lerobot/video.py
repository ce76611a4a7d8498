"""Videos of images that a policy learns from: AV1, a constant frame rate, every frame kept."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import av
from av.container import OutputContainer
from av.error import FFmpegError
from av.video.stream import VideoStream

from duobench.backend import Image
from duobench.errors import DataError
from duobench.files import replacing, writing
from duobench.types import CONTROL_HZ

FPS = int(CONTROL_HZ)
CODEC = "libsvtav1"
CRF, GROUP, PRESET = 30, 2, 12
"""Quality, frames from one key frame to the next, and speed: LeRobot's defaults. A group of two
frames lets a training read frames in any order without decoding many others."""
PIXEL_FORMAT = "yuv420p"
_OPTIONS = {
    "crf": str(CRF),
    "g": str(GROUP),
    "preset": str(PRESET),
    "svtav1-params": "lp=1",  # one thread: episodes are what runs in parallel
}
_CONTAINER_OPTIONS = {"fflags": "+bitexact", "movflags": "faststart"}
"""No identifiers that change from run to run; the index first, so that reading begins at once."""
_QUIET = ("SVT_LOG", "1")
"""Environment variable by which the encoder prints errors only."""


def describe(size: tuple[int, int]) -> dict[str, Any]:
    """What `meta/info.json` says about a video, under the keys that LeRobot's own writer uses.

    Args:
        size: Height and width in pixels.
    """
    return {
        "video.height": size[0],
        "video.width": size[1],
        "video.codec": "av1",
        "video.pix_fmt": PIXEL_FORMAT,
        "video.fps": FPS,
        "video.channels": 3,
        "has_audio": False,
        "video.g": GROUP,
        "video.crf": CRF,
        "video.preset": PRESET,
        "video.fast_decode": 0,
        "video.video_backend": "pyav",
        "video.extra_options": {},
        "is_depth_map": False,
    }


def write_videos(
    frames: Iterable[Mapping[str, Image]], paths: Mapping[str, Path], size: tuple[int, int]
) -> None:
    """Encode one video a camera side by side; each is whole or absent after a kill.

    Args:
        frames: Images (height, width, 3) by camera, frame by frame.
        paths: Where the video of each camera will be.
        size: Height and width of the images, both even.

    Raises:
        DataError: The images cannot be encoded.
        OutputError: A file cannot be written.
    """
    os.environ.setdefault(*_QUIET)
    with ExitStack() as stack:
        encoders = {}
        for camera, path in paths.items():
            temporary = stack.enter_context(replacing(path))
            encoders[camera] = stack.enter_context(_encoding(temporary, size))
        for images in frames:
            for camera, add in encoders.items():
                add(images[camera])


@contextmanager
def _encoding(path: Path, size: tuple[int, int]) -> Iterator[Callable[[Image], None]]:
    """Encode a video of the images that are added in the block."""
    with writing(path):
        container = av.open(path, "w", format="mp4", options=_CONTAINER_OPTIONS)
    try:
        stream = _stream(container, size)
        numbers = count()

        def mux(frame: av.VideoFrame | None) -> None:
            try:
                with writing(path):
                    container.mux(stream.encode(frame))
            except FFmpegError as error:
                raise DataError(f"A video cannot be encoded: {error}.") from error

        def add(image: Image) -> None:
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts = next(numbers)
            mux(frame)

        yield add
        mux(None)  # what the encoder still holds; after a failure FFmpeg crashes here
    finally:
        with writing(path):
            container.close()


def _stream(container: OutputContainer, size: tuple[int, int]) -> VideoStream:
    try:
        stream = container.add_stream(CODEC, rate=FPS, options=_OPTIONS)
    except FFmpegError as error:
        raise DataError(f"This build of PyAV cannot encode AV1: {error}.") from error
    if not isinstance(stream, VideoStream):
        raise AssertionError(f"{CODEC} encodes videos.")
    stream.height, stream.width = size
    stream.pix_fmt = PIXEL_FORMAT
    stream.codec_context.thread_count = 1
    return stream
