"""Demonstrations with object states: read from an export, and what a policy sees of them.

An export is made by `duobench export lerobot DATA --out OUT --per-task --cameras none
--object-state --action cartesian`; it needs neither LeRobot nor PyTorch to be read.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from duobench.lerobot_keys import ACTION, OBJECT_STATE, STATE, feature_names
from duobench.robot.kinematics import tool_frames
from duobench.types import ARM_JOINTS, SIDES

Rows = NDArray[np.float32]
OPENINGS = (9, 19)
"""Which of the 20 numbers of a label are the openings of the left and the right gripper."""
OPENS_FROM = 0.85
"""A gripper opens once it is told to go this part of the way, and closes from half of it: a network
that is unsure when to let go says something between, and would do so while it still lowers."""
CLOSES_FROM = 0.5


@dataclass(frozen=True)
class Demonstrations:
    """The rows of all episodes, one after the other."""

    state: Rows
    """Joints and openings (T, 16)."""
    objects: Rows
    """Object states (T, n)."""
    labels: Rows
    """Actions as labels (T, 20)."""
    lengths: NDArray[np.int64]
    """Rows of each episode."""
    names: tuple[str, ...]
    """What each number of an object state is."""

    @staticmethod
    def load(folder: Path, episodes: int | None = None) -> Demonstrations:
        """Read the first episodes of an export, or all of them."""
        info = json.loads((folder / "meta/info.json").read_text())
        files = sorted((folder / "data").rglob("*.parquet"))
        columns = [STATE, OBJECT_STATE, ACTION, "episode_index"]
        table = pq.ParquetDataset(files).read(columns=columns)
        number = table["episode_index"].to_numpy()
        kept = number < (number.max() + 1 if episodes is None else episodes)
        state, objects, labels = (
            np.array(table[name].to_pylist(), dtype=np.float32)[kept] for name in columns[:3]
        )
        names = feature_names(info, OBJECT_STATE) or []
        lengths = np.unique(number[kept], return_counts=True)[1]
        return Demonstrations(state, objects, labels, lengths, tuple(names))

    def chunks(self, horizon: int) -> NDArray[np.int64]:
        """Rows of the chunk (T, horizon) that begins in each row; the last row is held."""
        last = np.repeat(np.cumsum(self.lengths) - 1, self.lengths)
        return np.minimum(np.arange(len(last))[:, None] + np.arange(horizon), last[:, None])


def features(state: Rows, objects: Rows, names: tuple[str, ...]) -> Rows:
    """What a policy sees (T, k): everything, and the objects from the tools.

    Args:
        state: Joints and openings (T, 16).
        objects: Object states (T, n).
        names: What each number of an object state is.
    """
    joints = state.reshape(len(state), len(SIDES), -1)[..., :ARM_JOINTS].astype(np.float64)
    tools = [tool_frames(side, joints[:, side.index]) for side in SIDES]
    positions, rotations = (np.stack(part, axis=1) for part in zip(*tools, strict=True))
    seen = [state, positions.reshape(len(state), -1), objects]
    seen += [rotations[..., :2].reshape(len(state), -1)]
    seen += [positions[:, 0] - positions[:, 1]]
    for column, name in enumerate(names):
        vector = objects[:, None, column : column + 3]
        if name.endswith("_axis_x"):  # a direction
            seen += [_turned_back(rotations, np.repeat(vector, 2, axis=1))]
        elif name.endswith("_x") and "velocity" not in name:  # a position
            seen += [_turned_back(rotations, vector - positions)]
        if name.endswith("_x_axis_x"):  # what looks the same after a half or a quarter turn
            turn = np.arctan2(objects[:, column + 1], objects[:, column])[:, None]
            seen += [f(k * turn) for f in (np.cos, np.sin) for k in (2, 4)]
    return np.hstack(seen).astype(np.float32)


def _turned_back(rotations: NDArray[np.float64], vectors: NDArray[np.floating]) -> Rows:
    """Vectors (T, 2, 3) in the frames of both tools, (T, 6)."""
    seen = np.einsum("tsij,tsi->tsj", rotations, vectors)
    return seen.reshape(len(vectors), -1).astype(np.float32)


class Grippers:
    """Both grippers of an episode: they take the openings of the demonstrations, and no others."""

    def __init__(self, values: list[list[float]]) -> None:
        """Begin with open hands.

        Args:
            values: The openings that the demonstrations ask for, of the left and the right hand.
        """
        self._values = values
        self._now = [max(side) for side in values]

    def switch(self, label: Rows) -> None:
        """Put into a label (20,) what the grippers are to do, instead of what it says."""
        for side, column in enumerate(OPENINGS):
            told, now = float(label[column]), self._now[side]
            meant = [
                value
                for value in self._values[side]
                if value != now
                and (told - now) / (value - now) >= (OPENS_FROM if value > now else CLOSES_FROM)
            ]
            self._now[side] = min(meant, key=lambda value: abs(value - told), default=now)
            label[column] = self._now[side]


def openings(labels: Rows) -> list[list[float]]:
    """Every opening (to 1/1000) that labels ask for, of the left and the right hand."""
    return [np.unique(labels[:, column].round(3)).tolist() for column in OPENINGS]
