"""Words that every floor shares: sides, states and commands of the two arms, checked numbers."""

import math
import operator
import sys
from collections.abc import (
    Collection,
    Hashable,
    Iterable,
    Mapping,
)
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from numbers import Real
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duobench.core.errors import TaskError

Array = NDArray[np.float64]

CONTROL_HZ = 30.0
"""Control rate, that of the published demonstrations [paper, data sets]."""
ARM_JOINTS = 7
"""Joints of one arm."""
SIDE_SIZE = ARM_JOINTS + 1
"""Numbers of one side in a flat command: joints, then gripper opening."""
FLAT_SIZE = 2 * SIDE_SIZE
"""Numbers of a flat command or proprioception: left joints, left opening, right, right."""

OPENING_SLOTS = (ARM_JOINTS, ARM_JOINTS + SIDE_SIZE)
"""Places of the two gripper openings among them."""


class Side(StrEnum):
    """One of the robot's two arms; left and right are the robot's own."""

    LEFT = "left"
    RIGHT = "right"

    @property
    def other(self) -> "Side":
        """The opposite side."""
        return Side.RIGHT if self is Side.LEFT else Side.LEFT

    @property
    def index(self) -> int:  # pyright: ignore[reportIncompatibleMethodOverride] - a side is no text
        """0 for left, 1 for right: the row in every array that holds both sides."""
        return 0 if self is Side.LEFT else 1

    @property
    def sign(self) -> float:
        """Sign of the table's y on this side: +1 left, -1 right."""
        return 1.0 if self is Side.LEFT else -1.0


SIDES = (Side.LEFT, Side.RIGHT)


def real_array(values: ArrayLike, dtype: type[np.floating[Any]]) -> NDArray[Any]:
    """Numbers as an array of floats."""
    array = np.asanyarray(values)
    if array.dtype.kind in "cSUmM" or _is_masked(array):
        raise TypeError(
            f"Real numbers are expected, got {array.dtype} or masked values."
        )
    return np.asarray(array, dtype=dtype)


def _is_masked(array: NDArray[Any]) -> bool:
    # Nothing is masked where nothing has imported the module, whose import would stop the arms.
    masked = sys.modules.get("numpy.ma")
    return masked is not None and masked.is_masked(array)


def as_whole(value: Any) -> int | None:
    """A whole number, Python's or NumPy's, as an int; None for anything else, also for a bool."""
    if isinstance(value, bool):
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None


def as_count(value: Any) -> int | None:
    """A whole number from 1 on as an int; None for anything else."""
    number = as_whole(value)
    return number if number is not None and number >= 1 else None


def as_flag(value: Any) -> Any:
    """True or False of those, NumPy's, 1 and 0; anything else as it is."""
    return bool(value) if isinstance(value, Hashable) and value in (0, 1) else value


def as_several(values: Any) -> tuple[Any, ...] | None:
    """One word, or several things in an order, as a tuple; None for all else, such as a set.

    Words of NumPy become Python's, which files can hold.
    """
    if isinstance(values, str):
        return (str(values),)
    if isinstance(values, Iterable) and not isinstance(
        values, bytes | set | frozenset | Mapping
    ):
        with suppress(TypeError):  # an array without dimensions
            return tuple(
                str(value) if isinstance(value, str) else value for value in values
            )
    return None


def as_size(value: Any) -> tuple[int, int] | None:
    """Two counts, or one for a square, as height and width in pixels; None for anything else."""
    side = as_count(value)
    if side is not None:
        return side, side
    pixels = [as_count(part) for part in as_several(value) or ()]
    match pixels:
        case [int(height), int(width)]:
            return height, width
    return None


LONGEST = 2.0
"""Largest length or distance of a task, in metres: what is larger was given in another unit."""


def check_unit(
    what: str, unit: str, most: float, *values: object, endless: bool = False
) -> None:
    """Reject numbers too large for their unit; infinite ones stand for no bound where they may."""
    for value in values:
        number = float(value) if isinstance(value, (Real, np.ndarray)) else math.nan
        if not (abs(number) <= most or (endless and math.isinf(number))):
            or_none = ", or inf for no bound" if endless else ""
            raise TaskError(
                f"{what} is a number in {unit}, at most {most:.6g} either way{or_none}; "
                f"got {value!r}."
            )


def check_several(
    what: str,
    values: object,
    kind: type,
) -> None:
    """Reject what is no collection of one kind, such as one thing alone."""
    wrong, where = [values], " in a tuple, such as (one,)"
    if isinstance(values, Collection) and not isinstance(values, set | frozenset):
        wrong, where = [value for value in values if not isinstance(value, kind)], ""
    if wrong:
        given = type(wrong[0]).__name__
        raise TaskError(f"{what} takes {kind.__name__}s{where}; got a {given}.")


def _flat(joints: Array, openings: Array) -> Array:
    rows = np.empty((2, SIDE_SIZE))
    rows[:, :ARM_JOINTS] = joints
    rows[:, ARM_JOINTS] = openings
    return rows.ravel()


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class DuoCommand:
    """Command to both arms for one control step."""

    joints: Array
    """Joint targets (2, 7) in radians, left then right."""
    openings: Array
    """Gripper openings (2,), 0 closed to 1 open."""

    @classmethod
    def from_flat(cls, flat: ArrayLike) -> Self:
        """Make a command of 16 numbers: joints 1-7 and opening of the left arm, then the right."""
        rows = np.asarray(flat, dtype=np.float64).reshape(2, SIDE_SIZE)
        return cls(joints=rows[:, :ARM_JOINTS], openings=rows[:, ARM_JOINTS])

    @property
    def flat(self) -> Array:
        """The 16 numbers of `from_flat`."""
        return _flat(self.joints, self.openings)


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class DuoState:
    """State of both arms after a control step."""

    joints: Array
    """Joint positions (2, 7) in radians, left then right."""
    openings: Array
    """Gripper openings (2,), 0 closed to 1 open."""
    tcp_poses: Array
    """Tool centre points in the table frame (2, 7), x y z qx qy qz qw each, with qx >= 0."""

    @property
    def flat(self) -> Array:
        """Proprioception (16,), in the order of `DuoCommand.flat`."""
        return _flat(self.joints, self.openings)
