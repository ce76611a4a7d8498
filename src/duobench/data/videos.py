"""Videos of a rig's cameras, encoded while an episode is recorded, each in a thread of its own.

A video is written fragment by fragment, so that what a killed process leaves can be read up to its
last whole frames.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from queue import Full, Queue
from typing import Any, NamedTuple, Protocol

import av
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray

from duobench.core.backend import Image
from duobench.core.codecs import H264
from duobench.core.errors import DataError, DuoBenchError, OutputError
from duobench.core.files import digest_of, remove
from duobench.core.types import CONTROL_HZ
from duobench.core.video import VideoWriter
from duobench.data.schema import EpisodeInfo, VideoFacts, video_path

QUEUE = 20
"""Frames of a camera that wait for its encoder at most: 0.7 seconds, which is what a kill may cost,
and 55 MB."""
LONGEST_BACKLOG_S = 0.5
"""Seconds of work that may wait for an encoder: on a machine that is too slow, frames are left out
early, so that those which are not lose little when the process is killed."""
_SMOOTHING = 0.3
"""Weight of the last frame in what a frame takes."""
_REMEMBERED = 64
"""Accepted frames that a row may still belong to."""
_COLUMNS = ("frame", "frame_number", "frame_age")
"""Columns of a row about frames."""
_LONGEST_WAIT_S = 60.0
"""Seconds that a camera waits for an encoder that does nothing, if it waits."""


class CameraFrame(Protocol):
    """One image of a camera, as it came from it."""

    index: int
    """Number that the camera gave it; a gap is a lost frame."""
    time_s: float
    """When it was taken, on the clock of the arms."""
    image: Image
    """Red, green, blue (height, width, 3), both even; nothing changes it any more."""


class FrameSource(Protocol):
    """A camera that takes images all the time."""

    def listen(self, call: Callable[[Any], None] | None) -> None:
        """Give every frame from now on to a call, in any thread; None ends it."""


def count_frames(path: Path) -> int:
    """Count the whole frames of a video, which may be cut off; a `DataError` if it is missing."""
    try:
        with path.open("rb") as file, av.open(file, "r") as container:
            count = 0
            with suppress(FFmpegError):  # at the end of what a killed process has left
                for packet in container.demux(video=0):
                    if packet.is_corrupt:
                        break
                    count += bool(packet.size)
            return count
    except FileNotFoundError as error:
        raise DataError(f"{path} is missing.") from error
    except (FFmpegError, OSError, IndexError, ValueError):
        return 0  # not even its head was written


def describe(path: Path, left_out: int = 0) -> VideoFacts:
    """Facts about a finished video; a `DataError` if it is missing."""
    return VideoFacts(
        frames=count_frames(path), sha256=digest_of(path), left_out=left_out
    )


def recovered(
    partial: Path, info: EpisodeInfo, rows: NDArray[Any]
) -> tuple[NDArray[Any], dict[str, VideoFacts]]:
    """Rows of a killed recording that name frames which are there, and what is in its videos.

    Where a frame was not encoded yet, a row names the newest one before it, with its age.
    """
    rows, videos = rows.copy(), {}
    for place, camera in enumerate(info.videos):
        frame, number, age = (rows[name][:, place] for name in _COLUMNS)
        is_empty = bool((frame < 0).all())
        videos[camera] = (
            VideoFacts(frames=0) if is_empty else describe(video_path(partial, camera))
        )
        is_there = frame < (videos[camera].frames or 0)
        last = int(np.flatnonzero(is_there)[-1]) if is_there.any() else None
        taken = np.nan if last is None else rows["time"][last] - age[last]
        age[~is_there] = rows["time"][~is_there] - taken
        frame[~is_there] = -1 if last is None else frame[last]
        number[~is_there] = -1 if last is None else number[last]
    return rows, videos


class _Accepted(NamedTuple):
    """A frame that is in the video, or will be."""

    place: int = -1
    number: int = -1
    time_s: float = np.nan


class _Encoder:
    """Encodes the video of one camera, in a thread."""

    def __init__(
        self,
        path: Path,
        camera: FrameSource,
        rate: int,
        waits: bool,
    ) -> None:
        self.path, self.camera = path, camera
        self._error: DuoBenchError | None = None
        self._waits = waits
        self.missed: set[int] = set()
        """Numbers of frames that came while the encoder was too far behind."""
        self._pace_s = 0.0  # what a frame takes, as of late
        self._queue: Queue[Image | None] = Queue(QUEUE)
        self._accepted: deque[_Accepted] = deque([_Accepted()], _REMEMBERED)
        self._lock = threading.Lock()
        self._is_closed = False
        self._writer = VideoWriter(path, H264, rate)
        self._thread = threading.Thread(
            target=self._run, name=f"video {path.name}", daemon=True
        )
        self._thread.start()

    def check(self) -> None:
        """Raise what ended the encoder, if anything did."""
        if self._error is not None:
            raise self._error

    def take(self, frame: CameraFrame) -> None:
        """Encode a frame, unless it was taken already or is older than the last one."""
        with self._lock:
            last = self._accepted[-1]
            if (
                self._is_closed
                or self._error is not None
                or frame.time_s <= last.time_s
            ):
                return
            try:
                if (
                    not self._waits
                    and self._queue.qsize() * self._pace_s > LONGEST_BACKLOG_S
                ):
                    raise Full
                self._queue.put(frame.image, self._waits, _LONGEST_WAIT_S)
            except Full:
                self.missed.add(frame.index)
                return
            # A row asks again for the frame that it shows.
            self.missed.discard(frame.index)
            self._accepted.append(_Accepted(last.place + 1, frame.index, frame.time_s))

    def at(self, time_s: float) -> _Accepted:
        """The newest frame in the video that was taken until a time."""
        with self._lock:
            until = (one for one in reversed(self._accepted) if not one.time_s > time_s)
            return next(until, self._accepted[0])

    def close(self) -> None:
        """Encode what waits, and finish the video."""
        self.camera.listen(None)
        with self._lock:
            is_first, self._is_closed = not self._is_closed, True
        if is_first:
            self._queue.put(None)
            self._thread.join()

    def _run(self) -> None:
        while (image := self._queue.get()) is not None:
            if (
                self._error is None
            ):  # else the queue is emptied, so that nothing waits for it
                begun = time.monotonic()
                self._attempt(lambda image=image: self._writer.add(image))
                self._pace_s += _SMOOTHING * (time.monotonic() - begun - self._pace_s)
        self._attempt(self._writer.close)

    def _attempt(self, call: Callable[[], None]) -> None:
        try:
            call()
        except DuoBenchError as error:
            self._error = self._error or error  # the first one is the one that is said


class Videos:
    """The videos of an episode while it is recorded, at least one.

    Before `listen`, and after `pause`, `see` encodes one frame of each camera; from `listen` to
    `pause` or `close`, every frame is encoded.

    Args:
        episode: The episode's file; the videos are written beside it.
        cameras: The cameras by name.
        rates: Frames a second by camera.
        waits: Whether cameras wait for the encoder.

    Raises:
        OutputError: A video cannot be written.
        VideoError: A frame cannot be encoded.
    """

    def __init__(
        self,
        episode: Path,
        cameras: Mapping[str, FrameSource],
        rates: Mapping[str, int],
        waits: bool,
    ) -> None:
        self._encoders = {
            name: _Encoder(
                video_path(episode, name),
                camera,
                rates.get(name, round(CONTROL_HZ)),
                waits,
            )
            for name, camera in cameras.items()
        }
        self.is_listening = False
        """Whether every frame is encoded."""

    def listen(self) -> None:
        """Encode every frame from now on."""
        self.is_listening = True
        for encoder in self._encoders.values():
            encoder.camera.listen(encoder.take)

    def pause(self) -> None:
        """Encode frames no more until `listen`."""
        if self.is_listening:
            self.is_listening = False
            for encoder in self._encoders.values():
                encoder.camera.listen(None)

    def see(
        self, frames: Mapping[str, CameraFrame], time_s: float
    ) -> dict[str, NDArray[Any]]:
        """The columns of frames: places in the videos, numbers, and ages in seconds.

        Args:
            frames: The latest frame of each camera that has one, which are encoded too.
            time_s: Time of the row, on the clock of the frames.
        """
        seen = []
        for name, encoder in self._encoders.items():
            encoder.check()
            frame = frames.get(name)
            if frame is None:
                seen.append(encoder.at(time_s))
            else:
                encoder.take(frame)
                seen.append(encoder.at(frame.time_s))
        columns = zip(
            *((one.place, one.number, time_s - one.time_s) for one in seen), strict=True
        )
        return dict(zip(_COLUMNS, map(np.array, columns), strict=True))

    def close(self) -> None:
        """Encode what waits, and finish the videos; closing twice is harmless."""
        self.is_listening = False
        for encoder in self._encoders.values():
            encoder.close()

    def finish(self) -> dict[str, VideoFacts]:
        """Facts about the finished videos, by camera."""
        self.close()
        for encoder in self._encoders.values():
            encoder.check()
        try:
            return {
                name: describe(encoder.path, len(encoder.missed))
                if encoder.path.exists()
                else VideoFacts(frames=0, left_out=len(encoder.missed))
                for name, encoder in self._encoders.items()
            }
        except OSError as error:
            raise OutputError(f"A video cannot be read again: {error}.") from error

    def discard(self) -> None:
        """End the videos and remove them."""
        self.close()
        remove(*(encoder.path for encoder in self._encoders.values()))
