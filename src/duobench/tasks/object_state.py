"""State of all objects of a task as numbers: the observation `environment_state`.

It is privileged: a camera does not see it, and a real table does not tell it. The numbers of a task
are, in the order of its props: position and two axes of the rotation of every part that moves or is
placed at random, in the table frame (of a part on a hinge the angle, in radians); then the layout's
choices, one number 0 or 1 for each value. A task may have numbers of its own instead.
"""

from __future__ import annotations

from collections.abc import (
    Callable,
    Collection,
    Iterable,
    Mapping,
    Sequence,
)
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import OptionError
from duobench.core.randomness import Choice
from duobench.tasks.stages.predicates import CylinderRegion
from duobench.world.objects.mazes import MAZES, SEGMENTS
from duobench.world.objects.prop import Prop

if TYPE_CHECKING:
    from duobench.world.sim.questions import Questions

ENVIRONMENT_STATE = "environment_state"
"""Key of the object state in an observation, as LeRobot names it."""
LARGEST = 10.0
"""Bound of every number, so that spaces have limits: metres or m/s that only something has
which was thrown off the table. No angle, cell or count comes near."""
AXES = (("x", 0), ("z", 2))
"""The axes of a rotation that are given: names and columns of the rotation matrix. They say all of
it, without the jumps of angles and without the two signs of a quaternion."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Numbers:
    """Some numbers of an object state."""

    names: tuple[str, ...]
    """Name of each: "cube_x", "cube_z_axis_x", "chest/lid_angle"."""
    read: Callable[[Any], Sequence[float]]
    """Function that reads these numbers from a `Simulation`, in metres, radians and seconds."""
    vectorized: bool = False
    """Whether `read` also takes n simulations at once, and gives an array (n,) for each number."""


_numbers = partial(Numbers, vectorized=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class ObjectState:
    """The numbers of one task, in order."""

    parts: tuple[Numbers, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each number; unique."""
        return tuple(name for part in self.parts for name in part.names)

    def read(self, simulation: Questions) -> NDArray[np.float32]:
        """The numbers (n,) of the simulation's current state, from -10 to 10 (`LARGEST`).

        Of many simulations at once they are (simulations, n).
        """
        parts = [
            simulation.ask(part.read, vectorized=part.vectorized) for part in self.parts
        ]
        for part, numbers in zip(self.parts, parts, strict=True):
            if len(numbers) != len(part.names):
                raise OptionError(
                    f"The object state names {len(part.names)} numbers, {', '.join(part.names)}, "
                    f"but {len(numbers)} were read."
                )
        values = [number for part in parts for number in part]
        return np.array(values, dtype=np.float32).T.clip(-LARGEST, LARGEST)


def usual_numbers(
    props: Iterable[Prop], still: Collection[str], choices: Mapping[str, Choice]
) -> tuple[Numbers, ...]:
    """The numbers of a task that has none of its own.

    Args:
        props: All of them.
        still: Names of those that are at the same place in every layout, and stay there.
        choices: What a layout chooses.
    """
    objects = [
        numbers
        for prop in props
        for numbers in (
            *(() if prop.name in still else (pose(prop.name),)),
            *(
                hinge_angle(prop.part_name(part.name))
                for part in prop.parts
                if part.hinge
            ),
        )
    ]
    return (
        *objects,
        *(chosen(name, choice.options) for name, choice in choices.items()),
    )


def position(body: str) -> Numbers:
    """Origin of a body in the table frame, in metres: x, y, z."""
    return _numbers(
        names=tuple(f"{body}_{axis}" for axis in "xyz"),
        read=lambda simulation: simulation.origin(body),
    )


def pose(body: str) -> Numbers:
    """Origin of a body in the table frame, and the directions of its x and z axes there."""
    axes = [f"{body}_{name}_axis_{along}" for name, _ in AXES for along in "xyz"]
    places = [3 * row + column for _, column in AXES for row in range(3)]

    def read(simulation: Questions) -> list[float]:
        turned = simulation.axes(body)
        return [*simulation.origin(body), *(turned[place] for place in places)]

    return _numbers(names=(*position(body).names, *axes), read=read)


def hinge_angle(hinge: str) -> Numbers:
    """Angle of a hinge, in radians."""
    return _numbers(
        names=(f"{hinge}_angle",),
        read=lambda simulation: [simulation.angle(hinge)],
    )


def velocity(prop: str) -> Numbers:
    """Velocity of a free prop's origin in the table frame, in m/s: x, y, z."""
    return _numbers(
        names=tuple(f"{prop}_velocity_{axis}" for axis in "xyz"),
        read=lambda simulation: simulation.velocity(prop),
    )


def chosen(choice: str, options: Collection[str]) -> Numbers:
    """Choice of the layout: 1 for the chosen value, 0 for every other."""
    values = tuple(options)
    rows = {one: [float(one == other) for other in values] for one in values}
    return _numbers(
        names=tuple(f"{choice}_is_{value}" for value in values),
        read=lambda simulation: simulation.chosen(choice, rows),
    )


def known_of(
    choice: str, names: Sequence[str], values: Mapping[str, Sequence[float]]
) -> Numbers:
    """Numbers that follow from what the layout chose.

    Args:
        choice: Name of the variant.
        names: What each number is.
        values: The numbers for each value of the variant.
    """
    return _numbers(
        names=tuple(names),
        read=lambda simulation: simulation.chosen(choice, values),
    )


def heap(
    name: str,
    bodies: Sequence[str],
    vessels: Iterable[str],
    room: tuple[float, float, float],
) -> Numbers:
    """Centre and spread of many bodies, and the share of them that is in each vessel.

    The centre (x, y, z) is in the table frame; the spread is the root of the mean square of their
    distances from it, in metres.

    Args:
        name: What they are called together.
        bodies: The bodies.
        vessels: What they may be in.
        room: Radius, floor and rim of a vessel's hollow in its frame, in metres.
    """
    radius, floor, rim = room
    hollows = {
        vessel: CylinderRegion(
            body=vessel,
            radius=radius,
            low=floor,
            high=rim,
        )
        for vessel in vessels
    }

    def read(simulation: Questions) -> list[float]:
        at = np.array([simulation.origin(body) for body in bodies])
        centre = at.mean(axis=0)
        spread = np.sqrt(((at - centre) ** 2).sum(axis=1).mean(axis=0))
        shares = [
            sum(
                hollow.contains(simulation.relative_position(body, vessel))
                for body in bodies
            )
            / len(bodies)
            for vessel, hollow in hollows.items()
        ]
        return [*centre, spread, *shares]

    centre = [f"{name}_{axis}" for axis in "xyz"]
    inside = [f"{name}_in_{vessel}" for vessel in hollows]
    return _numbers(names=(*centre, f"{name}_spread", *inside), read=read)


def maze_of(choice: str) -> Numbers:
    """Start, goal and walls of the maze whose number the layout chose, in the board's frame.

    Cells are counted from 0 along the board's x (columns, eastwards) and y (rows, northwards). A
    wall is 1 where there is one between a cell and its eastern or northern neighbour, else 0.

    Args:
        choice: Name of the variant.
    """
    ends = [
        f"{end}_{along}" for end in ("start", "goal") for along in ("column", "row")
    ]
    walls = [
        f"wall_{'north' if wall.along_x else 'east'}_of_{wall.cell[0]}_{wall.cell[1]}"
        for wall in SEGMENTS
    ]
    values = {
        str(number): [
            *maze.start,
            *maze.goal,
            *(wall in maze.walls for wall in SEGMENTS),
        ]
        for number, maze in enumerate(MAZES)
    }
    return known_of(choice, [*ends, *walls], values)
