"""Actions as a data set for learning holds them, and their conversion to an environment's.

Tool rotations are six numbers there, the first two columns of the rotation matrix: unlike
quaternions they have one form for each rotation and no jumps, so that the mean of two labels means
something [Zhou et al. 2019].
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import ActionError
from duobench.core.spatial import rotation_vector, wxyz_from_matrix
from duobench.core.types import SIDES, Array
from duobench.envs import action_modes
from duobench.envs.action_modes import (
    CARTESIAN,
    CARTESIAN_RELATIVE,
    JOINT,
    ActionMode,
)

ROTATION_SIZE = 6
MIN_LENGTH = 1e-3
"""Least length of a rotation's columns; shorter or almost parallel ones define no rotation."""


def _names(*position: str) -> tuple[str, ...]:
    rotation = (f"rotation_{number}" for number in range(1, ROTATION_SIZE + 1))
    numbers = (*position, *rotation, "gripper")
    return tuple(f"{side}_{name}" for side in SIDES for name in numbers)


POSE_LABELS = _names("x", "y", "z")
"""Names of the 20 numbers of a Cartesian label: tool centre point in the table frame in metres, x
and y axes of the tool there, opening; left, then right."""
SHIFT_LABELS = _names("dx", "dy", "dz")
"""Names of the 20 numbers of a relative Cartesian label: a translation along the table's axes in
metres, a rotation about them as its first two columns, opening; left, then right."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ActionLabels:
    """Names and meaning of the numbers of an action in a data set."""

    mode: ActionMode
    """Action mode that the numbers are converted to."""
    names: tuple[str, ...]
    """Name of each number."""
    rotation_numbers: Callable[[Array], Array] | None = None
    """Numbers in which the mode gives a rotation matrix (3, 3); None if the labels are actions."""

    def to_actions(self, rows: NDArray[Any]) -> NDArray[np.float32]:
        """Convert labels (T, n), in the order of the names, to actions (T, m) of the mode."""
        if self.rotation_numbers is None:
            return np.asarray(rows, dtype=np.float32)
        sides = np.asarray(rows, dtype=np.float64).reshape(len(rows) * len(SIDES), -1)
        rotations = rotations_from_columns(sides[:, 3:-1])
        numbers = np.array([self.rotation_numbers(rotation) for rotation in rotations])
        actions = np.hstack([sides[:, :3], numbers, sides[:, -1:]])
        return actions.reshape(len(rows), -1).astype(np.float32)


def tool_labels(
    positions: Array,
    rotations: Array,
    openings: Array,
) -> Array:
    """Cartesian labels (T, 20), in the order of `POSE_LABELS` and `SHIFT_LABELS`.

    Args:
        positions: Positions or translations (T, 2, 3) in metres, left then right.
        rotations: Rotation matrices (T, 2, 3, 3).
        openings: Gripper openings (T, 2).
    """
    columns = np.swapaxes(rotations[..., :2], -1, -2).reshape(
        len(rotations), len(SIDES), -1
    )
    rows = np.concatenate([positions, columns, openings[..., None]], axis=-1)
    return rows.reshape(len(rows), -1)


def rotations_from_columns(columns: Array) -> Array:
    """Rotation matrices (n, 3, 3) from two columns (n, 6) each, by the Gram-Schmidt process.

    The first column keeps its direction; the second one is turned until it is normal to it.
    """
    first, second = columns[:, :3], columns[:, 3:]
    first = first / _lengths(first)
    second = second - (first * second).sum(axis=1, keepdims=True) * first
    second = second / _lengths(second)
    third = np.asarray(np.cross(first, second), dtype=np.float64)
    return np.stack([first, second, third], axis=-1)


def _lengths(vectors: Array) -> Array:
    lengths = np.sqrt((vectors * vectors).sum(axis=1, keepdims=True))
    if not (lengths > MIN_LENGTH).all():
        raise ActionError(
            "Six numbers of a rotation are its first two columns, which differ in direction and "
            f"are longer than {MIN_LENGTH:g}; got {vectors[(lengths <= MIN_LENGTH).ravel()][:1]}."
        )
    return lengths


def _quaternion(rotation: Array) -> Array:
    return wxyz_from_matrix(rotation)[[1, 2, 3, 0]]


LABELS: Mapping[str, ActionLabels] = MappingProxyType(
    {
        labels.mode.name: labels
        for labels in (
            ActionLabels(mode=JOINT, names=JOINT.names),
            ActionLabels(
                mode=CARTESIAN,
                names=POSE_LABELS,
                rotation_numbers=_quaternion,
            ),
            ActionLabels(
                mode=CARTESIAN_RELATIVE,
                names=SHIFT_LABELS,
                rotation_numbers=rotation_vector,
            ),
        )
    }
)
"""Labels that an export can hold, by the name of the mode that its actions stand for."""


def find(names: Sequence[str]) -> ActionLabels | None:
    """Return the labels with exactly these names, or None.

    The plain numbers of every action mode are labels too.
    """
    wanted = tuple(names)
    for labels in LABELS.values():
        if labels.names == wanted:
            return labels
    for mode in action_modes.ACTION_MODES.values():
        if mode.names == wanted:
            return ActionLabels(mode=mode, names=mode.names)
    return None
