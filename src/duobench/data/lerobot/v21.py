"""Metadata of an export in LeRobot's format v2.1, and files that others read beside it.

Isaac-GR00T reads `meta/modality.json`, which names parts of the state and of the actions, and
`meta/stats.json`, which LeRobot's v2.1 has no more [getting_started/data_preparation.md,
gr00t/data/stats.py]. openpi reads `norm_stats.json` in a folder of assets
[src/openpi/shared/normalize.py].
"""

import json
import re
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from duobench.core.lerobot_keys import ACTION, STATE
from duobench.data.lerobot.folder import (
    Export,
    as_json,
    columns,
    image_key,
)

NORM_STATS = "assets/duobench/norm_stats.json"
"""openpi's statistics in the folder of an export: `assets_dir` is `assets`, `asset_id` the next."""
_NORM = ("mean", "std", "q01", "q99")
_STATS = (*_NORM, "min", "max")
"""The statistics of openpi, and those of Isaac-GR00T, which takes slices of every one that it
finds, so that a count would stop it."""
_KINDS = {
    r"joint_\d": "arm",
    r"gripper": "gripper",
    r"d?[xyz]": "eef_position",
    r"q[xyzw]": "eef_quaternion",
    r"rotation_\d": "eef_rotation",
    r"joint_\d_velocity": "arm_velocity",
}
"""Part that a number belongs to, by a pattern of its name without the side; `eef` is the tool."""

Numbers = Mapping[str, Mapping[str, Any]]
"""Statistics by name of each feature."""


def files(
    export: Export, whole: Numbers, episodes: Sequence[Numbers]
) -> dict[str, str]:
    """The texts of all files but `info.json`, by their names in the folder of the export.

    They follow from the statistics of all rows, and from those of each episode.
    """
    rows = [
        {
            "episode_index": index,
            "tasks": [source.instruction],
            "length": source.length,
            **source.origin,
        }
        for index, source in enumerate(export.episodes)
    ]
    stats = [
        {"episode_index": index, "stats": each} for index, each in enumerate(episodes)
    ]
    tasks = [
        {"task_index": index, "task": task} for index, task in enumerate(export.tasks)
    ]
    own = {
        name: name for name in columns(export.vectors)
    }  # no images, which GR00T does not count
    return {
        "meta/episodes.jsonl": _lines(rows),
        "meta/episodes_stats.jsonl": _lines(stats),
        "meta/tasks.jsonl": _lines(tasks),
        "meta/stats.json": as_json(_chosen(whole, _STATS, own)),
        "meta/modality.json": as_json(_modality(export)),
        NORM_STATS: as_json(
            {"norm_stats": _chosen(whole, _NORM, {"state": STATE, "actions": ACTION})}
        ),
    }


def _lines(rows: Sequence[Mapping[str, Any]]) -> str:
    return "".join(
        f"{json.dumps(row, ensure_ascii=False, allow_nan=False)}\n" for row in rows
    )


def _modality(export: Export) -> dict[str, Any]:
    """Groups of numbers of state and actions, and names of images and words."""
    return {
        "state": _slices(export.vectors[STATE]),
        "action": _slices(export.vectors[ACTION]),
        "video": {
            name: {"original_key": image_key(name)} for name in export.options.videos
        },
        "annotation": {"human.task_description": {"original_key": "task_index"}},
    }


def _slices(names: Sequence[str]) -> dict[str, dict[str, int]]:
    """Range of the numbers of each part, by its name: `left_arm`, `left_gripper`."""
    slices, end = {}, 0
    for part, numbers in groupby(names, _part):
        start, end = end, end + len(list(numbers))
        slices[part] = {"start": start, "end": end}
    return slices


def _part(name: str) -> str:
    side, _, number = name.partition("_")
    (kind,) = (
        kind for pattern, kind in _KINDS.items() if re.fullmatch(pattern, number)
    )
    return f"{side}_{kind}"


def _chosen(
    whole: Numbers, names: Sequence[str], features: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Some statistics of some features, by the names under which they are read."""
    return {
        key: {name: whole[of][name] for name in names} for key, of in features.items()
    }
