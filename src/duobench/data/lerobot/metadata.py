"""Metadata of a finished export: `info.json`, `stats.json`, tables of tasks and episodes.

All of it is computed from the files of the episodes and from what was noted beside them. Statistics
are exact: of vectors from all rows, of images from counts of values.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from duobench.core.errors import DataError
from duobench.core.files import write
from duobench.core.lerobot_keys import ROBOT_TYPE
from duobench.core.types import Array
from duobench.core.video import Frame
from duobench.data.lerobot import depth, v21
from duobench.data.lerobot.folder import (
    CHUNK_SIZE,
    Export,
    ExportFolder,
    Residual,
    as_json,
    columns,
    describe,
    image_key,
)
from duobench.data.lerobot.options import Format
from duobench.data.recording import to_bytes, to_numpy

DATA_MB, VIDEO_MB = 100, 200
"""Sizes at which LeRobot's own writer begins another file; ours has one an episode."""
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
"""The quantiles that LeRobot reads, by name."""
LEVELS = 256
"""Values that a channel of an image can have."""
CHANNELS = 3

Counts = NDArray[np.int64]
"""Histogram of the values of each channel (3, 256), or of the codes of depth (1, 4096)."""
Statistics = dict[str, Array]
"""Statistics of one feature by name."""
_Lists = dict[str, dict[str, list[Any]]]
"""Statistics of all features by name."""


def finish(folder: ExportFolder, export: Export) -> list[Residual]:
    """Describe the data set as a whole, whose episodes are all finished; give their residuals."""
    videos = export.options.videos
    names = columns(export.vectors)
    read: list[dict[str, NDArray[Any]]] = []
    depths = export.options.depth_of
    counts = {name: no_counts(is_depth=name in depths) for name in videos}
    residuals: list[Residual] = []
    numbers: list[_Lists] = []
    cameras: dict[str, Any] = {}
    for index, source in enumerate(export.episodes):
        facts = folder.read_facts(index)
        read.append(_read(folder, index, source.length, names))
        of_images = {name: np.array(facts.counts[name]) for name in videos}
        for name, values in of_images.items():
            counts[name] += values
        cameras = cameras or facts.cameras
        if facts.residual is not None:
            residuals.append(facts.residual)
        numbers.append(_statistics(read[-1], of_images))
    rows = {name: np.concatenate([each[name] for each in read]) for name in names}
    whole = _statistics(rows, counts)
    if folder.format is Format.V21:
        for name, text in v21.files(export, whole, numbers).items():
            write(folder.path / name, text)
    else:
        write(folder.meta / "stats.json", as_json(whole))
        write(folder.meta / "tasks.parquet", to_bytes(_tasks(export.tasks)))
        table = pa.Table.from_pylist(
            [_episode(export, *each) for each in enumerate(numbers)]
        )
        write(folder.meta / "episodes/chunk-000/file-000.parquet", to_bytes(table))
    write(
        folder.meta / "info.json", as_json(_info(export, cameras))
    )  # last: it says that all is there
    return residuals


def _read(
    folder: ExportFolder, index: int, length: int, names: Sequence[str]
) -> dict[str, NDArray[Any]]:
    path = folder.data(index)
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise DataError(
            f"Cannot read {path}: {error} Delete it and export again."
        ) from error
    if table.num_rows != length or table.column_names != list(names):
        raise DataError(
            f"{path} belongs to another export. Delete it and export again."
        )
    return {name: to_numpy(table.column(name).combine_chunks()) for name in names}


def _statistics(
    rows: Mapping[str, NDArray[Any]], counts: Mapping[str, Counts]
) -> _Lists:
    features = {name: of_rows(values) for name, values in rows.items()}
    for name, values in counts.items():
        features[image_key(name)] = of_counts(values, len(rows["index"]))
    return {
        feature: {name: value.tolist() for name, value in numbers.items()}
        for feature, numbers in features.items()
    }


def _episode(
    export: Export,
    index: int,
    numbers: _Lists,
) -> dict[str, Any]:
    """Place of an episode and its statistics, as a row of the table of episodes."""
    source, (chunk, file) = export.episodes[index], divmod(index, CHUNK_SIZE)
    first = export.first_row(index)
    row: dict[str, Any] = {
        "episode_index": index,
        "tasks": [source.instruction],
        "length": source.length,
        **source.origin,
        "data/chunk_index": chunk,
        "data/file_index": file,
        "dataset_from_index": first,
        "dataset_to_index": first + source.length,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for name in export.options.videos:
        prefix = f"videos/{image_key(name)}"
        row |= {
            f"{prefix}/chunk_index": chunk,
            f"{prefix}/file_index": file,
            f"{prefix}/from_timestamp": 0.0,
            f"{prefix}/to_timestamp": source.length / export.options.fps,
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
            {
                "name": None,
                "field_name": None,
                **text,
                "metadata": {"encoding": "UTF-8"},
            }
        ],
        "columns": [
            {"name": "task_index", "field_name": "task_index", **column},
            {"name": "task", "field_name": "task", **text},
        ],
        "pandas_version": "2.2.0",
    }
    fields = [pa.field("task_index", pa.int64()), pa.field("task", pa.string())]
    arrays = [
        pa.array(range(len(instructions)), pa.int64()),
        pa.array(instructions, pa.string()),
    ]
    return pa.Table.from_arrays(
        arrays, schema=pa.schema(fields, {"pandas": json.dumps(pandas)})
    )


def _info(export: Export, cameras: Mapping[str, Any]) -> dict[str, Any]:
    episodes, options = len(export.episodes), export.options
    about = {"data_files_size_in_mb": DATA_MB, "video_files_size_in_mb": VIDEO_MB}
    if options.format is Format.V21:
        chunks = -(-episodes // CHUNK_SIZE)
        about = {
            "total_videos": episodes * len(options.videos),
            "total_chunks": chunks,
        }
    data_path, video_path = options.format.paths
    return {
        "codebase_version": options.format,
        "fps": options.fps,
        "features": describe(export, cameras),
        "total_episodes": episodes,
        "total_frames": export.frames,
        "total_tasks": len(export.tasks),
        "chunks_size": CHUNK_SIZE,
        **about,
        "data_path": data_path,
        "video_path": video_path if options.videos else None,
        "robot_type": f"{ROBOT_TYPE} {export.robot}".rstrip(),
        "splits": {"train": f"0:{episodes}"},
    }


def of_rows(rows: NDArray[Any]) -> Statistics:
    """Statistics (n,) of a feature's rows (T,) or (T, n), n being 1 for plain numbers."""
    values = rows.reshape(len(rows), -1).astype(np.float64)
    numbers = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
        "count": np.array([len(values)]),
    }
    quantiles = np.quantile(values, list(QUANTILES.values()), axis=0)
    return numbers | dict(zip(QUANTILES, quantiles, strict=True))


def no_counts(*, is_depth: bool = False) -> Counts:
    """Counts of no image, or of no depth."""
    shape = (1, depth.CODES) if is_depth else (CHANNELS, LEVELS)
    return np.zeros(shape, dtype=np.int64)


def count_values(counts: Counts, image: Frame) -> None:
    """Add an image (height, width, 3), or codes of depth (height, width), to counts, in place."""
    channels, levels = counts.shape
    values = image.reshape(-1, channels)
    for channel in range(channels):
        counts[channel] += np.bincount(values[:, channel], minlength=levels)


def of_counts(counts: Counts, frames: int) -> Statistics:
    """Statistics (3, 1, 1) of the counted images with channels in [0, 1], equal to NumPy's.

    Those of depth are (1, 1, 1), in metres.
    """
    is_depth = counts.shape[1] == depth.CODES
    values = depth.metres() if is_depth else np.arange(LEVELS) / (LEVELS - 1)
    channels = [_of_channel(each, values) for each in counts]
    numbers = {
        name: np.array([each[name] for each in channels]).reshape(-1, 1, 1)
        for name in channels[0]
    }
    return numbers | {"count": np.array([frames])}


def _of_channel(counts: NDArray[np.int64], values: Array) -> dict[str, float]:
    """Statistics of a channel; quantiles lie between neighbours in the sorted pixels as NumPy's."""
    levels, counts = values[counts > 0], counts[counts > 0]
    mean = np.average(levels, weights=counts)
    ends = counts.cumsum()
    places = np.column_stack(
        [ends - counts, ends - 1]
    )  # of a level's first and last pixel
    wanted = np.array(list(QUANTILES.values())) * (ends[-1] - 1)
    quantiles = np.interp(wanted, places.ravel(), levels.repeat(2))
    return {
        "min": levels[0],
        "max": levels[-1],
        "mean": mean,
        "std": np.sqrt(np.average((levels - mean) ** 2, weights=counts)),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }
