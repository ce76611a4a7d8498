"""Ten mazes of five by five cells, and how a ball runs through them when the board is tilted.

A tilt sends the ball along a row or a column until a wall stops it. Every maze is a tree: between
any two cells there is exactly one way, so all ten have the same number of walls and weigh the same.
They were found by a search over random trees for these properties, which the tests check again:

- from every cell, tilts along the board's axes bring the ball to the goal;
- the shortest way from the start takes five or six runs, and one of them leads away from the goal,
  so that a single diagonal tilt does not solve the maze.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

CELLS = 5
"""Cells along a side."""

Cell = tuple[int, int]
"""Column and row, counted along the board's x and y."""
START: Cell = (0, 0)
GOAL: Cell = (CELLS - 1, CELLS - 1)


class Direction(Enum):
    """Where a tilt sends the ball, as steps in columns and rows; the board's x points east."""

    EAST = (1, 0)
    NORTH = (0, 1)
    WEST = (-1, 0)
    SOUTH = (0, -1)

    def next(self, cell: Cell) -> Cell:
        """The neighbouring cell, which may lie outside the board."""
        return cell[0] + self.value[0], cell[1] + self.value[1]


@dataclass(frozen=True, slots=True, order=True)
class Segment:
    """A place for a wall: the edge between a cell and its eastern or northern neighbour."""

    cell: Cell
    """The western or southern one of the two cells."""
    along_x: bool
    """Whether the wall runs along x, so that the two cells are one above the other."""

    @staticmethod
    def beyond(cell: Cell, direction: Direction) -> Segment:
        """The edge that a step from a cell crosses."""
        first = min(cell, direction.next(cell))
        return Segment(first, along_x=direction.value[0] == 0)


SEGMENTS: tuple[Segment, ...] = tuple(
    Segment((i, j), along_x=along_x)
    for along_x in (False, True)
    for i in range(CELLS if along_x else CELLS - 1)
    for j in range(CELLS - 1 if along_x else CELLS)
)
"""Every place for a wall inside the board."""


@dataclass(frozen=True, slots=True)
class Maze:
    """Which of the places hold a wall."""

    walls: frozenset[Segment]
    """Edges between cells that are closed; the rim of the board is always closed."""

    @staticmethod
    def parsed(rows: Iterable[str]) -> Maze:
        """Parse rows of text.

        Args:
            rows: The rows of cells, the northern one first. A cell is two characters: `_` where a
                wall closes its southern side, `|` where one closes its eastern side.
        """
        walls = set()
        for j, row in zip(reversed(range(CELLS)), rows, strict=True):
            for i in range(CELLS):
                if row[2 * i] == "_" and j > 0:
                    walls.add(Segment.beyond((i, j), Direction.SOUTH))
                if row[2 * i + 1] == "|" and i < CELLS - 1:
                    walls.add(Segment.beyond((i, j), Direction.EAST))
        return Maze(frozenset(walls))

    def is_open(self, cell: Cell, direction: Direction) -> bool:
        """Whether the ball can pass from a cell to the next one."""
        within = all(0 <= k < CELLS for k in direction.next(cell))
        return within and Segment.beyond(cell, direction) not in self.walls

    def run(self, cell: Cell, direction: Direction) -> Cell:
        """Where the ball comes to rest when the board is tilted in a direction."""
        while self.is_open(cell, direction):
            cell = direction.next(cell)
        return cell

    def plan(self, cell: Cell, goal: Cell = GOAL) -> tuple[Direction, ...] | None:
        """A shortest sequence of tilts from a cell to the goal, or None if there is none."""
        plans: dict[Cell, tuple[Direction, ...]] = {cell: ()}
        for here in (queue := [cell]):
            if here == goal:
                return plans[here]
            for direction in Direction:
                end = self.run(here, direction)
                if end not in plans:
                    plans[end] = (*plans[here], direction)
                    queue.append(end)
        return None


_WIDTH = 2 * CELLS + 2
"""Characters from one board to the next."""
_MAP = (
    (
        "   |_    |  _  |_ _  |  _   _ _ _|    _ _ _  |      _ _  |",
        " |_ _  | |     |_  | |   |_  |_  |  _  |_ _  |   | |  _| |",
        "  _| |_| |  _|  _ _| |  _ _  |_  |     |_ _ _|   |_ _|_ _|",
        "  _ _| | |     |_  | |       |  _|  _|   | | |  _ _      |",
        "_ _ _|_ _|  _|_ _ _ _|  _|_|_ _ _|  _ _|_ _ _|  _ _ _|_|_|",
    ),
    (
        " |   | | |   |  _| | |   | | | | |  _  |     |    _ _ _  |",
        " |_|_ _  |  _ _ _ _  |  _  |_ _  |     | |_| |  _|   | | |",
        "  _|   | |    _  |  _|     |_ _  |   |_  |  _|     |_ _ _|",
        " |   |_| |  _ _| |_  |   |_ _ _  |    _|_|_  |  _|  _    |",
        "_ _|_ _ _|  _ _ _ _ _|  _ _ _ _|_|  _|_ _ _ _|  _ _|_ _|_|",
    ),
)
"""The ten boards, five beside each other; see `Maze.parsed`."""
MAZES: tuple[Maze, ...] = tuple(
    Maze.parsed([row[start : start + 2 * CELLS] for row in rows])
    for rows in _MAP
    for start in range(0, len(rows[0]), _WIDTH)
)
"""The ten boards of the task."""
