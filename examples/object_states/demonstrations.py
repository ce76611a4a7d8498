"""Demonstrations with object states: read from an export, and what a policy sees of them.

An export is made by `duobench export lerobot DATA --out OUT --per-task --cameras none
--object-state --after-success --action cartesian` (or `joint`); it needs neither LeRobot nor
PyTorch to be read.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from duobench.core.errors import DataError, PolicyError
from duobench.core.lerobot_keys import (
    ACTION,
    OBJECT_STATE,
    RECORDING_ROW,
    STATE,
    feature_names,
)
from duobench.envs.action_labels import LABELS, find
from duobench.envs.spaces import JOINT_NAMES
from duobench.world.robot.gripper import DEFAULT_GRIPPER

Rows = NDArray[np.float32]
UNTIL = ("end", "success", "release")
"""Where demonstrations may be cut: nowhere, at the step that succeeds, at the last opening."""
OPENS_FROM = 0.85
"""A gripper opens once it is told to go this part of the way, and closes from half of it: a network
that is unsure when to let go says something between, and would do so while it still lowers."""
CLOSES_FROM = 0.5
STILL = [2e-3] * 3 + [2e-2] * 6
"""What poses of a hand that stays where it is differ by at most: metres, and axes."""
MODES = {16: "joint", 20: "cartesian"}
"""Action modes, by how many numbers their labels have."""


@dataclass(frozen=True)
class Demonstrations:
    """The rows of all episodes, one after the other."""

    state: Rows
    """Joints and openings (T, 16)."""
    objects: Rows
    """Object states (T, n)."""
    labels: Rows
    """Actions as labels (T, 20), or (T, 16) in joint mode."""
    lengths: NDArray[np.int64]
    """Rows of each episode."""
    names: tuple[str, ...]
    """What each number of an object state is."""
    recorded: NDArray[np.int64] = field(default_factory=lambda: np.arange(0))
    """Row (T,) of its recording that each row is; files of policies may lack it."""
    gripper: str = DEFAULT_GRIPPER
    """What was on the arms."""
    columns: tuple[int, ...] = ()
    """Which numbers of the task's object state these are."""

    @staticmethod
    def load(
        folder: Path, episodes: int | None = None, until: str = "end"
    ) -> Demonstrations:
        """Read the first episodes of an export, or all of them, up to one of `UNTIL`.

        How fast things move is left out: no single image shows it.

        Raises:
            DataError: The folder holds no such export, or fewer episodes.
        """
        info = _described(folder)
        files = sorted((folder / "data").rglob("*.parquet"))
        columns = [STATE, OBJECT_STATE, ACTION, "episode_index", "next.success"]
        columns.append(RECORDING_ROW)
        table = pq.ParquetDataset(files).read(columns=columns)
        number = table["episode_index"].to_numpy()
        recorded = table[RECORDING_ROW].to_numpy()
        state, objects, labels = (_rows(table[name]) for name in columns[:3])
        state = state[
            :, : len(JOINT_NAMES)
        ]  # tool poses may follow, which are seen anyway
        if episodes is not None and episodes > number.max() + 1:
            raise DataError(
                f"{folder} has {number.max() + 1} demonstrations, and {episodes} were asked for."
            )
        kept = number < (number.max() + 1 if episodes is None else episodes)
        if until != "end":
            ends = table["next.success"].to_numpy()
            ends = ends if until == "success" else _last_openings(labels, number)
            kept &= _up_to_first(ends, number)
        state, objects, labels = state[kept], objects[kept], labels[kept]
        named = feature_names(info, OBJECT_STATE) or []
        columns = [n for n, name in enumerate(named) if "_velocity_" not in name]
        lengths = np.unique(number[kept], return_counts=True)[1]
        about = json.loads((folder / "meta/duobench.json").read_text())
        gripper = about.get("robot") or DEFAULT_GRIPPER
        return Demonstrations(
            state,
            objects[:, columns],
            labels,
            lengths,
            tuple(named[n] for n in columns),
            recorded[kept],
            gripper,
            tuple(columns),
        )

    def __add__(self, other: Demonstrations) -> Demonstrations:
        """Those of the other one behind these.

        Raises:
            DataError: They are of another gripper, other objects or other actions.
        """
        for name in ("gripper", "names", "columns"):
            if getattr(self, name) != getattr(other, name):
                raise DataError(
                    f"These cannot be learned from together, as `{name}` differs: "
                    f"{getattr(self, name)!r} and {getattr(other, name)!r}. Export both alike."
                )
        if action_mode(self.labels) != action_mode(other.labels):
            raise DataError(
                "Some actions are joint targets, and some are tool poses: export both with "
                "--action cartesian."
            )
        columns = ("state", "objects", "labels", "lengths", "recorded")
        both = {
            name: np.concatenate([getattr(self, name), getattr(other, name)])
            for name in columns
        }
        return replace(self, **both)

    def hashed(self) -> str:
        """The first digits of the SHA-256 of what is learned from."""
        named = json.dumps([self.names, self.columns, self.gripper])
        found = hashlib.sha256(named.encode())
        for part in (self.state, self.objects, self.labels, self.lengths):
            found.update(part.tobytes())
        return found.hexdigest()[:16]

    def chunks(self, horizon: int) -> NDArray[np.int64]:
        """Rows of the chunk (T, horizon) that begins in each row; the last row is held."""
        last = np.repeat(np.cumsum(self.lengths) - 1, self.lengths)
        return np.minimum(
            np.arange(len(last))[:, None] + np.arange(horizon), last[:, None]
        )


def _described(folder: Path) -> dict[str, Any]:
    """What an export says of itself, if it is one that can be learned from here."""
    what = "Export with --per-task --cameras none --object-state --action cartesian."
    try:
        info = json.loads((folder / "meta/info.json").read_text())
    except OSError as error:
        raise DataError(f"{folder} holds no export of one task. {what}") from error
    if feature_names(info, OBJECT_STATE) is None:
        raise DataError(f"{folder} does not say where the objects are. {what}")
    labels = find(feature_names(info, ACTION) or ())
    if labels is None or labels.mode.name not in MODES.values():
        raise DataError(
            f"The actions of {folder} are no targets of joints or tools. {what}"
        )
    return info


def _rows(column: pa.ChunkedArray) -> Rows:
    """A column of lists that are equally long (T, n)."""
    values = column.combine_chunks().flatten().to_numpy(zero_copy_only=False)
    return values.astype(np.float32).reshape(len(column), -1)


def _up_to_first(
    marked: NDArray[np.bool_], number: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """The rows of each episode up to the first one that is marked, and with it."""
    before = np.cumsum(marked) - marked
    start = np.searchsorted(number, number)
    return before == before[start]


def _last_openings(labels: Rows, number: NDArray[np.int64]) -> NDArray[np.bool_]:
    """The rows in which a gripper is told to open for the last time in an episode."""
    opens = np.zeros(len(labels), dtype=bool)
    opens[1:] = (np.diff(labels[:, opening_columns(labels)], axis=0) > 0).any(axis=1)
    opens[1:] &= number[1:] == number[:-1]
    rows = np.flatnonzero(opens)
    last = np.ones(len(rows), dtype=bool)
    last[:-1] = number[rows][1:] != number[rows][:-1]
    marked = np.zeros(len(labels), dtype=bool)
    marked[rows[last]] = True
    return marked


class Grippers:
    """Both grippers of an episode: they take the openings of the demonstrations, and no others.

    A hand stays where it is while its gripper closes or opens, as demonstrated: a network that is
    unsure when it lifts would say poses between, and lift a thing that it holds by its rim.
    """

    def __init__(
        self,
        values: list[list[float]],
        still: Sequence[Sequence[int]] = ((0, 0), (0, 0)),
    ) -> None:
        """Begin with open hands.

        Args:
            values: The openings that the demonstrations ask for, of the left and the right hand.
            still: For how many labels each hand stays where it is once its gripper is told to
                close, and to open.
        """
        self._values = values
        self._still = still
        self._now = [max(side) for side in values]
        self._left = [0 for _ in values]
        self._poses: list[Rows] = [np.empty(0, np.float32) for _ in values]

    def switch(self, label: Rows) -> None:
        """Put into a label what the grippers are to do, and where hands stay meanwhile."""
        for side, column in enumerate(opening_columns(label)):
            pose = label[column + 1 - label.size // 2 : column]
            if self._left[side]:
                self._left[side] -= 1
                pose[:] = self._poses[side]
            told, now = float(label[column]), self._now[side]
            meant = [
                value
                for value in self._values[side]
                if value != now
                and (told - now) / (value - now)
                >= (OPENS_FROM if value > now else CLOSES_FROM)
            ]
            if meant:
                value = min(meant, key=lambda value: abs(value - told))
                self._now[side] = value
                self._left[side] = self._still[side][int(value > now)]
                self._poses[side] = pose.copy()
            label[column] = self._now[side]


def stillness(labels: Rows, lengths: NDArray[np.int64]) -> list[list[int]]:
    """For how many labels a hand stays where it is, whenever its gripper was told to move.

    Args:
        labels: Poses and openings (T, 20).
        lengths: Rows of each episode.

    Returns:
        The fewest after it was told to close, and to open, of the left and the right hand.
    """
    ends = np.repeat(np.cumsum(lengths), lengths)
    found = []
    for column in opening_columns(labels):
        poses = labels[:, column + 1 - labels.shape[1] // 2 : column]
        changes = np.diff(labels[:, column].round(3))
        changes[ends[1:] != ends[:-1]] = 0
        fewest = []
        for way in (-1, 1):
            rows = np.flatnonzero(np.sign(changes) == way) + 1
            stays = [
                (abs(poses[row : ends[row]] - poses[row]) < STILL).all(1)
                for row in rows
            ]
            counts = [np.append(one, False).argmin() - 1 for one in stays]
            fewest.append(int(min(counts, default=0)))
        found.append(fewest)
    return found


def openings(labels: Rows) -> list[list[float]]:
    """Every opening (to 1/1000) that labels ask for, of the left and the right hand."""
    return [np.unique(labels[:, c].round(3)).tolist() for c in opening_columns(labels)]


def opening_columns(labels: Rows) -> list[int]:
    """Which numbers of a label are the openings: the last ones of the left and the right arm."""
    size = labels.shape[-1]
    return [size // 2 - 1, size - 1]


def action_mode(labels: Rows) -> str:
    """In which action mode labels are played, by how many numbers they have."""
    return MODES[labels.shape[-1]]


def checkpoint() -> Path:
    """What is played: the path in the variable CHECKPOINT."""
    path = os.environ.get("CHECKPOINT")
    if not path:
        raise PolicyError(
            "The variable CHECKPOINT names what is played, such as CHECKPOINT=exports/bin_sort or "
            "CHECKPOINT=bin_sort.npz."
        )
    return Path(path)


def to_actions(labels: Rows) -> Rows:
    """Actions (T, 16) of labels, as the environment takes them in that mode."""
    mode = action_mode(labels)
    return LABELS[mode].to_actions(labels) if mode in LABELS else labels
