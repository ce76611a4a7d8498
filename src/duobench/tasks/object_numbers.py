"""Object states of more than poses: many small things at once, and what a board of a maze is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from duobench.objects.mazes import MAZES, SEGMENTS
from duobench.stages.predicates import CylinderRegion
from duobench.tasks.object_state import Numbers, known_of

if TYPE_CHECKING:
    from duobench.sim.simulation import Simulation


def heap(
    name: str, bodies: Sequence[str], vessels: Iterable[str], room: tuple[float, float, float]
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
        vessel: CylinderRegion(body=vessel, radius=radius, low=floor, high=rim)
        for vessel in vessels
    }

    def read(simulation: Simulation) -> list[float]:
        at = np.array([simulation.position(body) for body in bodies])
        centre = at.mean(axis=0)
        spread = math.sqrt(float(((at - centre) ** 2).sum(axis=1).mean()))
        shares = [
            sum(hollow.contains(simulation.relative_position(body, vessel)) for body in bodies)
            / len(bodies)
            for vessel, hollow in hollows.items()
        ]
        return [*centre.tolist(), spread, *shares]

    centre = [f"{name}_{axis}" for axis in "xyz"]
    inside = [f"{name}_in_{vessel}" for vessel in hollows]
    return Numbers(names=(*centre, f"{name}_spread", *inside), read=read)


def maze_of(choice: str) -> Numbers:
    """Start, goal and walls of the maze whose number the layout chose, in the board's frame.

    Cells are counted from 0 along the board's x (columns, eastwards) and y (rows, northwards). A
    wall is 1 where there is one between a cell and its eastern or northern neighbour, else 0.

    Args:
        choice: Name of the variant.
    """
    ends = [f"{end}_{along}" for end in ("start", "goal") for along in ("column", "row")]
    walls = [
        f"wall_{'north' if wall.along_x else 'east'}_of_{wall.cell[0]}_{wall.cell[1]}"
        for wall in SEGMENTS
    ]
    values = {
        str(number): [*maze.start, *maze.goal, *(wall in maze.walls for wall in SEGMENTS)]
        for number, maze in enumerate(MAZES)
    }
    return known_of(choice, [*ends, *walls], values)
