"""Videos of a rig's cameras, encoded while an episode is recorded, each in a thread of its own.

A video is written fragment by fragment, so that what a killed process leaves can be read up to its
last whole frames.
"""

from __future__ import annotations

import hashlib
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Full, Queue

import av
import numpy as np
from av.error import FFmpegError

from duobench.backend import Image
from duobench.data.real.robot import Camera, Frame
from duobench.data.schema import VIDEO_SUFFIX, VideoFacts
from duobench.errors import DataError, DuoBenchError, OutputError
from duobench.files import writing
from duobench.types import CONTROL_HZ, POLICY_CAMERAS, Array
from duobench.video import H264, VideoWriter

QUEUE = 20
"""Frames of a camera that wait for its encoder at most: 0.7 seconds, which is what a kill may cost,
and 55 MB."""
_REMEMBERED = 64
"""Accepted frames that a row may still belong to."""
_LONGEST_WAIT_S = 60.0
"""How long a camera waits for an encoder that does nothing, where it waits."""


def video_path(episode: Path, camera: str) -> Path:
    """Where the video of a camera is, of an episode whose file, finished or not, is given."""
    return episode.with_name(f"{episode.stem}.{camera}{VIDEO_SUFFIX}")


def episode_of(video: Path) -> tuple[str, str] | None:
    """The name of the episode that a video belongs to, and the camera; None for other files."""
    name, dot, camera = video.name.removesuffix(VIDEO_SUFFIX).rpartition(".")
    is_one = video.name.endswith(VIDEO_SUFFIX) and dot and camera in POLICY_CAMERAS
    return (name, camera) if is_one else None


def count_frames(path: Path) -> int:
    """Whole frames of a video, which may end anywhere.

    Raises:
        DataError: There is none.
    """
    try:
        with path.open("rb") as file, av.open(file) as container:
            count = 0
            try:
                for packet in container.demux(video=0):
                    if packet.is_corrupt:
                        break
                    count += bool(packet.size)
            except FFmpegError:
                pass  # the end of what a killed process has left
            return count
    except FileNotFoundError as error:
        raise DataError(f"{path} is missing.") from error
    except (FFmpegError, OSError, IndexError, ValueError):
        return 0  # not even its head was written


def describe(path: Path, left_out: int = 0) -> VideoFacts:
    """What an episode says about a finished video.

    Raises:
        DataError: There is none.
    """
    frames = count_frames(path)
    with path.open("rb") as file:
        return VideoFacts(
            frames=frames,
            sha256=hashlib.file_digest(file, "sha256").hexdigest(),
            left_out=left_out,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class _Accepted:
    """A frame that is in the video, or will be."""

    place: int = -1
    """Its place in the video."""
    number: int = -1
    """Number that the camera gave it."""
    time_s: float = np.nan
    """When it was taken."""


class _Stream:
    """The video of one camera."""

    def __init__(self, path: Path, camera: Camera, rate: int, waits: bool) -> None:
        self.path, self.camera = path, camera
        self.error: DuoBenchError | None = None
        self._waits = waits
        self._missed: set[int] = set()
        self._queue: Queue[Image | None] = Queue(QUEUE)
        self._accepted: deque[_Accepted] = deque([_Accepted()], _REMEMBERED)
        self._lock = threading.Lock()
        self._is_closed = False
        self._writer = VideoWriter(path, H264, rate)
        self._thread = threading.Thread(target=self._run, name=f"video {path.name}", daemon=True)
        self._thread.start()

    @property
    def left_out(self) -> int:
        """Frames that are not in the video, because the encoder was too far behind."""
        return len(self._missed)

    def take(self, frame: Frame) -> None:
        """Have a frame encoded, unless it was taken already, or is older than the last one."""
        with self._lock:
            last = self._accepted[-1]
            if self._is_closed or self.error is not None or frame.time_s <= last.time_s:
                return
            try:
                self._queue.put(frame.image, self._waits, _LONGEST_WAIT_S)
            except Full:
                self._missed.add(frame.index)
                return
            self._missed.discard(frame.index)  # a row asks again for the frame that it shows
            self._accepted.append(
                _Accepted(place=last.place + 1, number=frame.index, time_s=frame.time_s)
            )

    def at(self, time_s: float) -> _Accepted:
        """The newest frame in the video that was taken until a time."""
        with self._lock:
            for accepted in reversed(self._accepted):
                if not accepted.time_s > time_s:
                    return accepted
            return self._accepted[0]

    def close(self) -> None:
        """Encode what waits, and finish the video."""
        self.camera.listen(None)
        with self._lock:
            is_first, self._is_closed = not self._is_closed, True
        if is_first:
            self._queue.put(None)
            self._thread.join()

    def _run(self) -> None:
        try:
            while (image := self._queue.get()) is not None:
                self._writer.add(image)
            self._writer.close()
        except DuoBenchError as error:
            self.error = error
            self._drain()

    def _drain(self) -> None:
        """Let nobody wait for an encoder that has ended."""
        while not self._is_closed:
            try:
                self._queue.get(timeout=0.1)
            except Empty:
                continue
        while not self._queue.empty():
            self._queue.get()
        try:
            self._writer.close()
        except DuoBenchError:
            return  # the first error is the one that is said


class Videos:
    """The videos of an episode while it is recorded.

    At first they hold the one frame that `see` takes. After `listen` every frame is encoded, until
    `close`.
    """

    def __init__(
        self, episode: Path, cameras: Mapping[str, Camera], rates: Mapping[str, int], waits: bool
    ) -> None:
        """Begin videos beside an episode's file.

        Args:
            episode: The file.
            cameras: The cameras by name.
            rates: Their frames a second.
            waits: Whether cameras wait for the encoder.
        """
        self._streams = {
            name: _Stream(
                video_path(episode, name), camera, rates.get(name, round(CONTROL_HZ)), waits
            )
            for name, camera in cameras.items()
        }
        self._is_listening = False

    @property
    def is_listening(self) -> bool:
        """Whether every frame is encoded."""
        return self._is_listening

    def listen(self) -> None:
        """Encode every frame from now on."""
        self._is_listening = True
        for stream in self._streams.values():
            stream.camera.listen(stream.take)

    def see(self, frames: Mapping[str, Frame], time_s: float) -> dict[str, Array]:
        """Which frames belong to a row.

        Args:
            frames: The latest frame of each camera that has one, which are encoded too.
            time_s: Time of the row, on the clock of the frames.

        Returns:
            The columns of frames: places in the videos, numbers, and ages in seconds.

        Raises:
            OutputError: A video cannot be written.
            VideoError: A frame cannot be encoded.
        """
        seen = []
        for name, stream in self._streams.items():
            if stream.error is not None:
                raise stream.error
            if (frame := frames.get(name)) is None:
                seen.append(stream.at(time_s))
            else:
                stream.take(frame)
                seen.append(stream.at(frame.time_s))
        return {
            "frame": np.array([one.place for one in seen], dtype=np.int64),
            "frame_number": np.array([one.number for one in seen], dtype=np.int64),
            "frame_age": np.array([time_s - one.time_s for one in seen]),
        }

    def close(self) -> None:
        """Encode what waits, and finish the videos; closing twice is harmless."""
        self._is_listening = False
        for stream in self._streams.values():
            stream.close()

    def finish(self) -> dict[str, VideoFacts]:
        """What the finished videos hold, by camera.

        Raises:
            OutputError: One could not be written.
            VideoError: A frame could not be encoded.
        """
        self.close()
        for stream in self._streams.values():
            if stream.error is not None:
                raise stream.error
        try:
            return {
                name: describe(stream.path, stream.left_out)
                if stream.path.exists()
                else VideoFacts(frames=0, left_out=stream.left_out)
                for name, stream in self._streams.items()
            }
        except OSError as error:
            raise OutputError(f"A video cannot be read again: {error}.") from error

    def discard(self) -> None:
        """End the videos and remove them."""
        self.close()
        for stream in self._streams.values():
            with writing(stream.path):
                stream.path.unlink(missing_ok=True)
