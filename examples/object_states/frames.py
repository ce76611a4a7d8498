"""What a policy on object states sees, and the frames in which it says where to go.

A hand goes to things: to a cube, to the other hand, to a place on the table. So both what is seen
and what is commanded are told in the frames of the tools, the objects and the table. A frame of an
object is turned by quarters about its z axis until its x axis points forwards (within 45 degrees):
what looks the same after a quarter turn is then the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import DataError
from duobench.core.types import ARM_JOINTS, SIDES
from duobench.world.robot.frames import ROBOT, Robot

Rows = NDArray[np.float32]
QUARTERS = 4
_QUARTER = 2 * math.pi / QUARTERS
_MAZE_SIDE, _BOARD = 5, "board"
"""Cells along a side of the maze of `ball_maze`, and what it is a part of."""


@dataclass(frozen=True)
class Frames:
    """Of T states and K things: the left tool, the right tool, every object, the table."""

    positions: NDArray[np.float64]
    """Origins (T, K, 3) in metres, in the table frame."""
    rotations: NDArray[np.float64]
    """Rotation matrices (T, K, 3, 3), the columns of which are axes in the table frame."""
    quarters: NDArray[np.int64]
    """By how many quarters (T, K) the x axis of an object was turned clockwise."""


def frames(
    state: Rows, objects: Rows, names: tuple[str, ...], robot: Robot = ROBOT
) -> Frames:
    """The frames in a state.

    Args:
        state: Joints and openings (T, 16).
        objects: Object states (T, n).
        names: What each number of an object state is.
        robot: Whose tools they are.
    """
    joints = state.reshape(len(state), len(SIDES), -1)[..., :ARM_JOINTS].astype(
        np.float64
    )
    tools = [robot.tool_frames(side, joints[:, side.index]) for side in SIDES]
    table = np.tile(np.eye(3), (len(state), 1, 1))
    positions, rotations = [p for p, _ in tools], [r for _, r in tools]
    quarters = [np.zeros(len(state), np.int64)] * len(SIDES)
    for thing in bodies(names):
        column = names.index(f"{thing}_x")
        rotation, turned = table, quarters[0]
        if f"{thing}_x_axis_x" in names:
            rotation, turned = _forwards(
                *(_vector(objects, names, thing, a) for a in "xz")
            )
        positions.append(objects[:, column : column + 3].astype(np.float64))
        rotations.append(rotation)
        quarters.append(turned)
    positions.append(np.zeros((len(state), 3)))
    rotations.append(table)
    quarters.append(quarters[0])
    return Frames(
        *(np.stack(part, axis=1) for part in (positions, rotations, quarters))
    )


def bodies(names: tuple[str, ...]) -> list[str]:
    """The objects of which a state tells where they are."""
    ends = ("_axis_x", "_velocity_x")
    return [
        n.removesuffix("_x") for n in names if n.endswith("_x") and not n.endswith(ends)
    ]


def places_in(names: tuple[str, ...]) -> list[slice]:
    """Where the places of objects stand."""
    first = [names.index(f"{body}_x") for body in bodies(names)]
    return [slice(x, x + 3) for x in first]


def features(
    state: Rows, objects: Rows, names: tuple[str, ...], robot: Robot = ROBOT
) -> Rows:
    """What a policy sees (T, k): openings, objects, and every tool and object from every object.

    Joints are not seen: where tools are says all, and a network would know layouts by them.

    Args:
        state: Joints and openings (T, 16).
        objects: Object states (T, n).
        names: What each number of an object state is.
        robot: Whose tools they are.

    Raises:
        DataError: The object states have other numbers, as those of another task.
    """
    if objects.shape[1] != len(names):
        raise DataError(
            f"Object states of {objects.shape[1]} numbers are those of another task than the "
            f"demonstrated ones, which have {len(names)}."
        )
    here, rows = frames(state, objects, names, robot), len(state)
    openings = state.reshape(rows, len(SIDES), -1)[..., -1]
    seen = [openings, objects]
    for k in range(here.positions.shape[1]):
        back = here.rotations[:, k]
        ways = np.delete(here.positions, k, axis=1) - here.positions[:, k, None]
        seen += [np.einsum("tij,tki->tkj", back, ways).reshape(rows, -1)]
        turns = np.einsum("tij,tkil->tkjl", back, here.rotations[:, : len(SIDES)])[
            ..., :2
        ]
        seen += [turns.reshape(rows, -1)]
    things = slice(len(SIDES), -1)
    seen += [here.rotations[:, things, :, 0].reshape(rows, -1)]
    seen += [np.eye(QUARTERS)[here.quarters[:, things]].reshape(rows, -1)]
    if _BOARD in bodies(names) and "goal_row" in names:
        seen += [
            _maze(objects, names, here.quarters[:, 2 + bodies(names).index(_BOARD)])
        ]
    return np.hstack(seen).astype(np.float32)


def columns(names: tuple[str, ...]) -> list[slice]:
    """Where features tell of each thing where all others are from it."""
    first = len(SIDES) + len(names)
    things = len(SIDES) + len(bodies(names)) + 1
    ways = []
    for _ in range(things):
        ways.append(slice(first, first + 3 * (things - 1)))
        first = ways[-1].stop + 6 * len(SIDES)
    return ways


def with_pose_noise(
    objects: Rows,
    names: tuple[str, ...],
    place: float,
    turn: float,
    rng: np.random.Generator,
) -> Rows:
    """Object states (T, n) in which each object is a little elsewhere and turned otherwise.

    Args:
        objects: Object states (T, n).
        names: What each number of an object state is.
        place: Standard deviation of where an object is (m, along each axis).
        turn: Standard deviation of how it is turned (rad, about each axis).
        rng: What is drawn from.
    """
    told = objects.copy()
    for thing in bodies(names):
        column = names.index(f"{thing}_x")
        told[:, column : column + 3] += place * rng.normal(size=(len(told), 3))
        if f"{thing}_x_axis_x" not in names:
            continue
        turned = rotations_by(turn * rng.normal(size=(len(told), 3)))
        for axis in "xz":
            column = names.index(f"{thing}_{axis}_axis_x")
            part = told[:, column : column + 3]
            told[:, column : column + 3] = (turned @ part[..., None])[..., 0]
    return told


def cross_matrices(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrices (..., 3, 3) that multiply as a cross product with vectors (..., 3) does."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*vectors.shape, 3)


def rotations_by(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    axis = cross_matrices(vectors / np.maximum(angle[..., 0], 1e-12))
    return np.eye(3) + np.sin(angle) * axis + (1 - np.cos(angle)) * axis @ axis


def rotations_of(
    x: NDArray[np.floating], z: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Rotation matrices (..., 3, 3) whose first and third columns are axes (..., 3)."""
    return np.stack([x, np.cross(z, x), z], axis=-1)


def turns_between(
    now: NDArray[np.float64], wanted: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Vectors (..., 3) by which rotations (..., 3, 3) are to be turned to be others that are near.

    Their length is the sine of the angle.
    """
    error = wanted @ np.swapaxes(now, -1, -2)
    odd = (error - np.swapaxes(error, -1, -2)) / 2
    return np.stack([odd[..., 2, 1], odd[..., 0, 2], odd[..., 1, 0]], axis=-1)


def _vector(objects: Rows, names: tuple[str, ...], thing: str, axis: str) -> Rows:
    column = names.index(f"{thing}_{axis}_axis_x")
    return objects[:, column : column + 3].astype(np.float64)


def _forwards(x: Rows, z: Rows) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Rotations (T, 3, 3) of two axes (T, 3), turned back by quarters about z, and these (T,).

    Forwards is what lies nearest to it across z, so that a tilted object has a side that does too.
    """
    y = np.cross(z, x)
    quarters = np.round(np.arctan2(-y[:, 0], x[:, 0]) / _QUARTER).astype(np.int64)
    quarters %= QUARTERS
    ahead = np.choose(quarters, (x.T, -y.T, -x.T, y.T)).T
    return rotations_of(ahead, z), quarters


def _maze(objects: Rows, names: tuple[str, ...], quarters: NDArray[np.int64]) -> Rows:
    """Start, goal and walls of the maze (T, 4 + 2·5·5), in the frame of the turned board.

    A point of the board is turned with it, so its cells and walls are numbered anew.
    """
    middle = (_MAZE_SIDE - 1) / 2
    seen = np.zeros((len(objects), 4 + 2 * _MAZE_SIDE**2), np.float32)
    for turn in range(QUARTERS):
        rows = np.flatnonzero(quarters == turn)
        way = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turn)
        for k, cell in enumerate(("start", "goal")):
            column = names.index(f"{cell}_column")
            seen[rows, 2 * k : 2 * k + 2] = (
                objects[rows, column : column + 2] - middle
            ) @ way.T
        for column, name in enumerate(names):
            if not name.startswith("wall_"):
                continue
            _, kind, _, *cell = name.split("_")
            shift = np.array([kind == "east", kind == "north"]) / 2
            at = np.array(cell, dtype=float) + shift
            x, y = way @ (at - middle) + middle
            between = 0 if x % 1 else 1  # columns, or rows
            place = int(
                between * _MAZE_SIDE**2 + math.floor(x) * _MAZE_SIDE + math.floor(y)
            )
            seen[rows, 4 + place] = objects[rows, column]
    return seen
