"""What describes a finished export: `info.json`, `stats.json`, tables of tasks and episodes.

All of it is computed from the files of the episodes and from what was noted beside them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from duobench.data.lerobot import statistics
from duobench.data.lerobot.folder import (
    CHUNK_SIZE,
    FPS,
    Export,
    ExportFolder,
    Residual,
    columns,
    describe,
    image_key,
    location,
)
from duobench.data.recording import to_bytes, to_numpy
from duobench.errors import DataError
from duobench.files import write
from duobench.types import CONTROL_HZ

FORMAT = "v3.0"
ROBOT = "franka_fr3_duo"
DATA_MB, VIDEO_MB = 100, 200
"""Sizes at which LeRobot's own writer begins another file; ours has one an episode."""
_Statistics = dict[str, dict[str, list[Any]]]
"""Lists of numbers by feature and name."""


def finish(folder: ExportFolder, export: Export) -> list[Residual]:
    """Write everything that describes the data set as a whole, whose episodes are all finished.

    Returns:
        What inverse kinematics left in each episode, where it was used.
    """
    cameras = export.options.cameras
    names = columns(export.vectors)
    read: list[dict[str, NDArray[Any]]] = []
    counts = {camera: statistics.no_counts() for camera in cameras}
    residuals: list[Residual] = []
    episodes = []
    for index, source in enumerate(export.episodes):
        facts = folder.read_facts(index)
        read.append(_read(folder, index, source.length, names))
        of_images = {camera: np.array(facts.counts[camera]) for camera in cameras}
        for camera, values in of_images.items():
            counts[camera] += values
        if facts.residual is not None:
            residuals.append(facts.residual)
        episodes.append(_episode(export, index, _statistics(read[-1], of_images)))
    whole = {name: np.concatenate([each[name] for each in read]) for name in names}
    write(folder.meta / "stats.json", _json(_statistics(whole, counts)))
    write(folder.meta / "tasks.parquet", to_bytes(_tasks(export.tasks)))
    table = pa.Table.from_pylist(episodes)
    write(folder.meta / "episodes/chunk-000/file-000.parquet", to_bytes(table))
    write(folder.meta / "info.json", _json(_info(export)))  # last: it says that all is there
    return residuals


def _read(
    folder: ExportFolder, index: int, length: int, names: Sequence[str]
) -> dict[str, NDArray[Any]]:
    path = folder.data(index)
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise DataError(f"Cannot read {path}: {error} Delete it and export again.") from error
    if table.num_rows != length or table.column_names != list(names):
        raise DataError(f"{path} belongs to another export. Delete it and export again.")
    return {name: to_numpy(table.column(name).combine_chunks()) for name in names}


def _statistics(
    rows: Mapping[str, NDArray[Any]], counts: Mapping[str, statistics.Counts]
) -> _Statistics:
    features = {name: statistics.of_rows(values) for name, values in rows.items()}
    for camera, values in counts.items():
        features[image_key(camera)] = statistics.of_counts(values, len(rows["index"]))
    return {
        feature: {name: value.tolist() for name, value in numbers.items()}
        for feature, numbers in features.items()
    }


def _episode(export: Export, index: int, numbers: _Statistics) -> dict[str, Any]:
    """Where an episode is, and its statistics, as a row of the table of episodes."""
    source, (chunk, file) = export.episodes[index], location(index)
    first = export.first_row(index)
    row: dict[str, Any] = {
        "episode_index": index,
        "tasks": [source.instruction],
        "length": source.length,
        "data/chunk_index": chunk,
        "data/file_index": file,
        "dataset_from_index": first,
        "dataset_to_index": first + source.length,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for camera in export.options.cameras:
        prefix = f"videos/{image_key(camera)}"
        row |= {
            f"{prefix}/chunk_index": chunk,
            f"{prefix}/file_index": file,
            f"{prefix}/from_timestamp": 0.0,
            f"{prefix}/to_timestamp": source.length / CONTROL_HZ,
        }
    for feature, values in numbers.items():
        row |= {f"stats/{feature}/{name}": value for name, value in values.items()}
    return row


def _tasks(instructions: list[str]) -> pa.Table:
    """The table of instructions, which are its index for pandas."""
    column = {"metadata": None, "pandas_type": "int64", "numpy_type": "int64"}
    text = {"metadata": None, "pandas_type": "unicode", "numpy_type": "object"}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [
            {"name": None, "field_name": None, **text, "metadata": {"encoding": "UTF-8"}}
        ],
        "columns": [
            {"name": "task_index", "field_name": "task_index", **column},
            {"name": "task", "field_name": "task", **text},
        ],
        "pandas_version": "2.2.0",
    }
    fields = [pa.field("task_index", pa.int64()), pa.field("task", pa.string())]
    arrays = [pa.array(range(len(instructions)), pa.int64()), pa.array(instructions, pa.string())]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, {"pandas": json.dumps(pandas)}))


def _info(export: Export) -> dict[str, Any]:
    episodes, options = len(export.episodes), export.options
    place = "chunk-{chunk_index:03d}/file-{file_index:03d}"
    return {
        "codebase_version": FORMAT,
        "fps": FPS,
        "features": describe(export.vectors, options.cameras, options.size),
        "total_episodes": episodes,
        "total_frames": export.frames,
        "total_tasks": len(export.tasks),
        "chunks_size": CHUNK_SIZE,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "data_path": f"data/{place}.parquet",
        "video_path": f"videos/{{video_key}}/{place}.mp4" if options.cameras else None,
        "robot_type": ROBOT,
        "splits": {"train": f"0:{episodes}"},
    }


def _json(document: object) -> str:
    return json.dumps(document, indent=4, ensure_ascii=False, allow_nan=False) + "\n"
