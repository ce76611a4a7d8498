"""The export of one episode: numbers, videos, and what is noted about them."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from duobench.backend import Image
from duobench.data.images import ImageSource
from duobench.data.lerobot import statistics
from duobench.data.lerobot.actions import joint_targets
from duobench.data.lerobot.features import ACTION, COLUMNS, DOMAINS, STATE, schema
from duobench.data.lerobot.folder import EpisodeFacts, ExportFolder
from duobench.data.lerobot.options import ExportOptions, Pairing
from duobench.data.lerobot.video import write_videos
from duobench.data.recording import Recording
from duobench.errors import DataError
from duobench.files import write
from duobench.types import CONTROL_HZ, Array


@dataclass(frozen=True, kw_only=True, slots=True)
class Job:
    """An episode that is to be exported."""

    source: Path
    """Its recording."""
    sha256: str
    """Hash of the recording's file when the export began."""
    folder: Path
    """Folder of the export."""
    options: ExportOptions
    """What was chosen."""
    index: int
    """Number of the episode in the export."""
    first_row: int
    """Rows of the export before it."""
    task_index: int
    """Number of its instruction."""


class EpisodeExporter:
    """Exports one episode after the other; keeps the model of a task for the next one."""

    def __init__(self) -> None:
        """Begin without a model."""
        self._images: ImageSource | None = None
        self._key: tuple[str, ExportOptions] | None = None

    def __call__(self, job: Job) -> int:
        """Export an episode, unless that is done.

        Returns:
            The job's index.

        Raises:
            DataError: The recording cannot be read, shown or encoded, or has changed.
            OutputError: A file cannot be written.
        """
        folder, options = ExportFolder(job.folder), job.options
        recording = Recording.read(job.source)
        if hash_of(job.source) != job.sha256:
            raise DataError(f"{job.source} has changed since the export began; begin it anew.")
        actions, residual = joint_targets(recording, options.action)
        counts = {camera: statistics.no_counts() for camera in options.cameras}
        if options.cameras:
            paths = {camera: folder.video(camera, job.index) for camera in options.cameras}
            frames = self._frames(recording, options, counts)
            write_videos(frames, paths, options.size, int(CONTROL_HZ))
        write(folder.data(job.index), _parquet(rows(recording, actions, job)))
        noted = {camera: values.tolist() for camera, values in counts.items()}
        folder.write_facts(job.index, EpisodeFacts(counts=noted, residual=residual))
        return job.index

    def close(self) -> None:
        """Free the model."""
        if self._images is not None:
            self._images.close()
            self._images = None

    def _frames(
        self,
        recording: Recording,
        options: ExportOptions,
        counts: dict[str, statistics.Counts],
    ) -> Iterator[dict[str, Image]]:
        """Render the images of every row, and count their values."""
        key = recording.info.task, options
        if self._images is None or key != self._key:
            self.close()
            self._images = ImageSource(
                recording.info.task, cameras=options.cameras, size=options.size, look=options.look
            )
            self._key = key
        for row in np.arange(len(recording)) + _offset(options):
            images = self._images.images(recording, int(row))
            for camera in options.cameras:
                statistics.count_values(counts[camera], images[camera])
            yield images


def hash_of(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def rows(recording: Recording, actions: Array, job: Job) -> dict[str, NDArray[Any]]:
    """The columns of an episode, one row an action.

    Args:
        recording: The episode.
        actions: Its actions (T, 16).
        job: Its place in the export.
    """
    length, offset = len(recording), _offset(job.options)
    number = np.arange(length)
    return {
        STATE: recording.agent_pos[offset : offset + length],
        ACTION: actions.astype(np.float32),
        "next.reward": recording.reward.astype(np.float32),
        "next.done": number == length - 1,
        "next.success": recording.success[1:],
        "stage": recording.stage[offset : offset + length],
        "domain": np.full(length, DOMAINS.index("sim")),
        "timestamp": (number / CONTROL_HZ).astype(np.float32),
        "frame_index": number,
        "episode_index": np.full(length, job.index),
        "index": job.first_row + number,
        "task_index": np.full(length, job.task_index),
    }


def _offset(options: ExportOptions) -> int:
    """How many rows after its action's an observation is."""
    return int(options.pairing is Pairing.DELAYED)


def _parquet(columns: dict[str, NDArray[Any]]) -> bytes:
    """Columns as a Parquet file."""
    arrow = schema()
    arrays = []
    for name in COLUMNS:
        values = pa.array(np.ascontiguousarray(columns[name]).reshape(-1))
        kind = arrow.field(name).type
        if pa.types.is_fixed_size_list(kind):
            values = pa.FixedSizeListArray.from_arrays(values, type=kind)
        arrays.append(values.cast(kind))
    with io.BytesIO() as buffer:
        pq.write_table(pa.Table.from_arrays(arrays, schema=arrow), buffer)
        return buffer.getvalue()
