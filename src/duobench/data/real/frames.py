"""Frames of recorded videos, by their places."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import numpy as np
from av.error import FFmpegError

from duobench.backend import Image
from duobench.errors import DataError


class VideoFrames:
    """Reads frames of one video; fast where their places ascend."""

    def __init__(self, path: Path) -> None:
        """Open a video.

        Raises:
            DataError: It cannot be read.
        """
        self._path = path
        self._open()

    def _open(self) -> None:
        try:
            self._container = av.open(self._path)
        except (FFmpegError, OSError) as error:
            raise DataError(f"{self._path} cannot be read: {error}.") from error
        self._frames: Iterator[av.VideoFrame] = self._container.decode(video=0)
        self._place = -1
        self._image: av.VideoFrame | None = None

    def read(self, place: int) -> Image:
        """A frame (height, width, 3).

        Args:
            place: Its place in the video, from 0 on.

        Raises:
            DataError: There is no such frame, or it cannot be decoded.
        """
        if place < self._place:
            self.close()
            self._open()
        try:
            while self._place < place:
                self._image = next(self._frames)
                self._place += 1
        except (StopIteration, FFmpegError, OSError) as error:
            raise DataError(
                f"{self._path} has no frame {place} that can be read; it has {self._place + 1}."
            ) from error
        if self._image is None:
            raise DataError(f"{self._path}: places of frames begin with 0, got {place}.")
        return np.asarray(self._image.to_ndarray(format="rgb24"), dtype=np.uint8)

    def close(self) -> None:
        """Close the video."""
        self._container.close()

    def __enter__(self) -> Self:
        """The reader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the video."""
        self.close()
