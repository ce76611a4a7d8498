"""The export of one episode: numbers, videos, and what is noted about them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from duobench.backend import Image
from duobench.data.images import ImageSource
from duobench.data.lerobot import statistics
from duobench.data.lerobot.actions import joint_targets
from duobench.data.lerobot.features import ACTION, COLUMNS, DOMAINS, STATE, schema
from duobench.data.lerobot.folder import SCHEMA, EpisodeFacts, Export, ExportFolder
from duobench.data.lerobot.options import ExportOptions, Pairing
from duobench.data.lerobot.video import write_videos
from duobench.data.parquet import to_arrow, to_bytes
from duobench.data.recording import Recording
from duobench.errors import DataError
from duobench.files import encode, write
from duobench.types import CONTROL_HZ, Array


def exporter(data: Path, folder: ExportFolder, export: Export) -> Callable[[int], int]:
    """What exports one episode after the other; it keeps the model of a task for the next one.

    Args:
        data: Folder of the data set.
        folder: Folder of the export.
        export: What is exported.

    Returns:
        A function of the episode's index, which it returns. It raises a `DataError` if the
        recording cannot be read, shown or encoded, or has changed, and an `OutputError` if a file
        cannot be written.
    """
    options = export.options
    source_of = lru_cache(maxsize=1)(
        partial(ImageSource, cameras=options.cameras, size=options.size, look=options.look)
    )

    def export_one(index: int) -> int:
        episode = export.episodes[index]
        path = data / episode.file
        recording = Recording.read(path)
        if hash_of(path) != episode.sha256:
            raise DataError(f"{path} has changed since the export began; begin it anew.")
        actions, residual = joint_targets(recording, options.action)
        counts = {camera: statistics.no_counts() for camera in options.cameras}
        if options.cameras:
            paths = {camera: folder.video(camera, index) for camera in options.cameras}
            source = source_of(recording.info.task)
            frames = _frames(source, recording, _offset(options), counts)
            write_videos(frames, paths, options.size)
        columns = rows(recording, actions, export, index)
        arrays = [to_arrow(columns[name]) for name in COLUMNS]
        write(folder.data(index), to_bytes(pa.Table.from_arrays(arrays, schema=schema())))
        noted = {camera: values.tolist() for camera, values in counts.items()}
        facts = EpisodeFacts(counts=noted, residual=residual)
        write(folder.facts(index), encode(facts, SCHEMA))
        return index

    return export_one


def _frames(
    source: ImageSource, recording: Recording, offset: int, counts: dict[str, statistics.Counts]
) -> Iterator[dict[str, Image]]:
    """Render the images of every row, and count their values."""
    for row in range(offset, offset + len(recording)):
        images = source.images(recording, row)
        for camera, image in images.items():
            statistics.count_values(counts[camera], image)
        yield images


def hash_of(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def rows(
    recording: Recording, actions: Array, export: Export, index: int
) -> dict[str, NDArray[Any]]:
    """The columns of an episode, one row an action.

    Args:
        recording: The episode.
        actions: Its actions (T, 16).
        export: What is exported.
        index: Number of the episode in the export.
    """
    length, offset = len(recording), _offset(export.options)
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
        "episode_index": np.full(length, index),
        "index": export.first_row(index) + number,
        "task_index": np.full(length, export.tasks.index(recording.info.instruction)),
    }


def _offset(options: ExportOptions) -> int:
    """How many rows after its action's an observation is."""
    return int(options.pairing is Pairing.DELAYED)
