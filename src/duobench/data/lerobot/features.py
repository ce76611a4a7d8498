"""What an exported data set holds: its features, as LeRobot, Hugging Face and Arrow name them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from duobench.lerobot_keys import DOMAIN, IMAGE_PREFIX
from duobench.types import CONTROL_HZ
from duobench.video import AV1

FPS = int(CONTROL_HZ)
Vectors = Mapping[str, Sequence[str]]
"""Names of the numbers of each column that holds several in a row, by the name of the column."""
_SCALARS = {
    "next.reward": "float32",
    "next.done": "bool",
    "next.success": "bool",
    "stage": "int64",
    DOMAIN: "int64",
    # LeRobot's own, in its order:
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""Columns of one number a row. Only names that begin with `observation` or `action` reach a
policy, so that the others are free to add."""


def columns(vectors: Vectors) -> tuple[str, ...]:
    """Names of all columns of the Parquet files, in order."""
    return *vectors, *_SCALARS


def image_key(camera: str) -> str:
    """Name of a camera's images."""
    return f"{IMAGE_PREFIX}{camera}"


def describe(
    vectors: Vectors, cameras: Sequence[str], size: tuple[int, int]
) -> dict[str, dict[str, Any]]:
    """All features, as `meta/info.json` lists them.

    Args:
        vectors: Columns of several numbers a row.
        cameras: Cameras whose images are in the data set.
        size: Height and width of their images in pixels.
    """
    numbers = {
        column: {"dtype": "float32", "shape": [len(names)], "names": list(names)}
        for column, names in vectors.items()
    }
    images = {
        image_key(camera): {
            "dtype": "video",
            "shape": [*size, 3],
            "names": ["height", "width", "channels"],
            "info": _describe_video(size),
        }
        for camera in cameras
    }
    scalars = {
        name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in _SCALARS.items()
    }
    return numbers | images | scalars


def _describe_video(size: tuple[int, int]) -> dict[str, Any]:
    """What `meta/info.json` says about a video, under the keys that LeRobot's own writer uses.

    Args:
        size: Height and width in pixels.
    """
    return {
        "video.height": size[0],
        "video.width": size[1],
        "video.codec": "av1",
        "video.pix_fmt": AV1.pixel_format,
        "video.fps": FPS,
        "video.channels": 3,
        "has_audio": False,
        "video.g": int(AV1.options["g"]),
        "video.crf": int(AV1.options["crf"]),
        "video.preset": int(AV1.options["preset"]),
        "video.fast_decode": 0,
        "video.video_backend": "pyav",
        "video.extra_options": {},
        "is_depth_map": False,
    }


def schema(vectors: Vectors) -> pa.Schema:
    """The Arrow schema of the Parquet files, with the types that Hugging Face reads."""
    fields = [pa.field(name, pa.list_(pa.float32(), len(n))) for name, n in vectors.items()]
    fields += [pa.field(name, pa.from_numpy_dtype(dtype)) for name, dtype in _SCALARS.items()]
    types: dict[str, Any] = {
        name: {
            "feature": {"dtype": "float32", "_type": "Value"},
            "length": len(names),
            "_type": "List",
        }
        for name, names in vectors.items()
    }
    types |= {name: {"dtype": dtype, "_type": "Value"} for name, dtype in _SCALARS.items()}
    return pa.schema(fields, metadata={"huggingface": json.dumps({"info": {"features": types}})})
