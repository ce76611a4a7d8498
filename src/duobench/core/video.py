"""The encoders of videos, frame by frame, into a file or into memory, and of single images."""

import io
import math
import os
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import (
    closing,
    contextmanager,
    nullcontext,
    suppress,
)
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO, cast

import av
import numpy as np
from av.container import OutputContainer
from av.error import FFmpegError
from av.video.reformatter import ColorRange, Colorspace, VideoReformatter
from av.video.stream import VideoStream
from numpy.typing import NDArray
from PIL import Image as Pillow

from duobench.core.codecs import Codec
from duobench.core.errors import VideoError
from duobench.core.files import writing

Image = NDArray[np.uint8]
Frame = Image | NDArray[np.uint16]
"""An image (height, width, 3), or numbers (height, width) of a codec that keeps them."""
JPEG_QUALITY = 80
_BT601, _LIMITED = 6, 1
"""Matrix and range of colours (SMPTE 170M, 16 to 235), as streams say them."""
_EXACT = 0x2 | 0x2000 | 0x40000 | 0x80000
"""Flags of FFmpeg's conversion of colours: bilinear, full chroma, accurate, the same bits
everywhere. PyAV has names for them since 17."""
_QUARTERS_UP = 3, 0, 0
"""Quarters of a level by which each plane is raised; see `in_yuv`."""
_QUIET = ("SVT_LOG", "1")
"""Environment variable by which the encoder of AV1 prints errors only."""


class VideoWriter:
    """Encodes a video frame by frame; it begins with the first one, and ends when it is closed.

    The target is a file, or a stream in memory (not for AV1, whose index moves to the front);
    without a frame nothing is written into it. The rate is in frames a second.
    """

    def __init__(
        self, target: Path | BinaryIO, codec: Codec, rate: Fraction | int
    ) -> None:
        self._target = target
        self._codec = codec
        self._rate = rate
        self._open: tuple[OutputContainer, VideoStream] | None = None
        self._frames = 0
        self._is_broken = False
        self._converter = VideoReformatter()

    def add(self, image: Frame) -> None:
        """Add a frame, whose height and width are even."""
        with self._encoding():
            self._open = self._open or self._opened(*image.shape[:2])
            if self._codec.is_data:
                frame = in_yuv(np.asarray(image, np.uint8), self._converter)
            else:
                kind = "rgb24" if image.dtype == np.uint8 else self._codec.pixel_format
                frame = av.VideoFrame.from_ndarray(image, format=kind)
            frame.pts = self._frames
            self._frames += 1
            container, stream = self._open
            with _ordinary_priority():  # threads begin with the first frame
                packets = stream.encode(frame)
            container.mux(packets)

    def close(self) -> None:
        """Finish the video; one that failed is left as it is."""
        if self._open is None:
            return
        container, stream = self._open
        self._open = None
        try:
            if not self._is_broken:  # FFmpeg would crash here
                with self._encoding():
                    container.mux(stream.encode())
        finally:
            with self._encoding():
                container.close()

    @contextmanager
    def _encoding(self) -> Iterator[None]:
        target = self._target
        try:
            with writing(target) if isinstance(target, Path) else nullcontext():
                yield
        except FFmpegError as error:
            self._is_broken = True
            raise VideoError(
                f"A video cannot be encoded with {self._codec.encoder}: {error}."
            ) from error
        except BaseException:
            self._is_broken = True
            raise

    def _opened(self, height: int, width: int) -> tuple[OutputContainer, VideoStream]:
        codec = self._codec
        os.environ.setdefault(*_QUIET)
        # Bit-exact: no identifiers that change from run to run.
        options = {"fflags": "+bitexact", **codec.container_options}
        container = av.open(
            self._target,
            "w",
            format=codec.container,
            options=options,
        )
        stream = container.add_stream(
            codec.encoder, rate=self._rate, options=dict(codec.options)
        )
        if not isinstance(stream, VideoStream):
            raise AssertionError(f"{codec.encoder} encodes videos.")
        stream.height, stream.width = height, width
        stream.pix_fmt = codec.pixel_format
        stream.codec_context.thread_count = 1
        if codec.is_data:
            stream.codec_context.colorspace = _BT601
            stream.codec_context.color_range = _LIMITED
        return container, stream


def in_yuv(image: Image, converter: VideoReformatter) -> av.VideoFrame:
    """An image (height, width, 3), both even, as a frame of yuv420p.

    FFmpeg's usual way back to RGB, which LeRobot takes too, cuts off the fraction of each of its
    products. So numbers are rounded from two bits more, and luma is raised by three quarters of a
    level: read in that way images are 0.1 of 255 too dark in the mean, not 1, and 0.8 too bright
    where a reader rounds.
    """
    fine = converter.reformat(
        av.VideoFrame.from_ndarray(image, format="rgb24"),
        format="yuv420p10le",
        interpolation=_EXACT,
        dst_colorspace=Colorspace.ITU601,
        dst_color_range=ColorRange.MPEG,
    )
    flat: list[NDArray[np.uint8]] = []
    for plane, up in zip(fine.planes, _QUARTERS_UP, strict=True):
        numbers = np.frombuffer(cast(Any, plane), np.uint16)
        rows = numbers.reshape(plane.height, -1)
        levels = (rows[:, : plane.width] + (2 + up)) >> 2
        flat.append(levels.astype(np.uint8).ravel())
    planes = np.concatenate(flat).reshape(-1, fine.width)
    frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
    frame.colorspace, frame.color_range = _BT601, _LIMITED
    return frame


def in_rgb(frame: av.VideoFrame) -> Image:
    """A decoded frame as an image (height, width, 3), rounded to the nearest."""
    image = frame.reformat(format="rgb24", interpolation=_EXACT).to_ndarray()
    return np.asarray(image, dtype=np.uint8)


@contextmanager
def _ordinary_priority() -> Iterator[None]:
    """Take back the realtime priority that the encoder of AV1 gives to all threads where it may.

    A user with that right, such as root, would have encoders, and all that is started after them,
    keep everything else on the machine from running.
    """
    tasks = Path("/proc/self/task")
    ordinary = getattr(os, "SCHED_OTHER", None)
    if ordinary is None or not tasks.is_dir() or os.sched_getscheduler(0) != ordinary:
        yield
        return
    yield
    if os.sched_getscheduler(0) == ordinary:
        return
    for task in tasks.iterdir():
        with suppress(ProcessLookupError):
            os.sched_setscheduler(int(task.name), ordinary, os.sched_param(0))


def write_video(
    frames: Iterable[Frame], target: Path | BinaryIO, codec: Codec, rate: Fraction | int
) -> None:
    """Encode a video of frames; see `VideoWriter`."""
    with closing(VideoWriter(target, codec, rate)) as writer:
        for image in frames:
            writer.add(image)


def last_frame(path: Path) -> Image:
    """The last frame (height, width, 3) of a video."""
    try:
        with av.open(path) as container:
            container.seek(container.duration or 0)  # to the last key frame
            frames = deque(container.decode(video=0), maxlen=1)
    except (FFmpegError, OSError, IndexError) as error:
        raise VideoError(f"{path} cannot be decoded: {error}.") from error
    if not frames:
        raise VideoError(f"{path} has no frame.")
    return in_rgb(frames[0])


def jpeg(image: Image, width: int | None = None) -> bytes:
    """An image (height, width, 3) as JPEG, of at most so many pixels across."""
    picture = Pillow.fromarray(image)
    if width is not None:
        picture = picture.reduce(max(1, math.ceil(picture.width / width)))
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=JPEG_QUALITY)
    return file.getvalue()
