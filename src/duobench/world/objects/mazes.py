"""Ten mazes of five by five cells, and how a ball runs through them when the board is tilted.

A tilt sends the ball along a row or a column until a wall stops it. Every maze is a tree: between
any two cells there is exactly one way, so all ten have the same number of walls and weigh the same.
Start and goal are in corners, another pair on every board. The boards were found by a search over
random trees for these properties, which the tests check:

- from every cell, tilts along the board's axes bring the ball to the goal;
- the shortest way from the start takes eight runs, and one of them leads away from the goal, so
  that a single diagonal tilt does not solve the maze;
- no fixed sequence of tilts that `dev/tools/mazes.py` finds, with prices in control steps, brings
  the ball to rest in the goal of more than five boards in the 301 steps that an episode leaves.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum

CELLS = 5
"""Cells along a side."""

Cell = tuple[int, int]
"""Column and row, counted along the board's x and y."""
CORNERS: tuple[Cell, ...] = (
    (0, 0),
    (CELLS - 1, 0),
    (0, CELLS - 1),
    (CELLS - 1, CELLS - 1),
)
"""Cells of starts and goals."""


class Direction(Enum):
    """Direction of the ball after a tilt, in columns and rows; the board's x points east."""

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
    def beyond(cell: Cell, direction: Direction) -> "Segment":
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


@dataclass(frozen=True, kw_only=True, slots=True)
class Maze:
    """Walls of a board, and the start and goal of the ball."""

    walls: frozenset[Segment]
    """Edges between cells that are closed; the rim of the board is always closed."""
    start: Cell
    """First cell of the ball."""
    goal: Cell
    """Cell in which it shall come to rest."""

    @staticmethod
    def parsed(rows: Iterable[str]) -> "Maze":
        """Parse rows of text.

        Args:
            rows: The rows of cells, the northern one first. A cell is two characters. The first is
                `_` where a wall closes its southern side; in the start's cell it is `S` with such a
                wall and `s` without, in the goal's `G` and `g`. The second is `|` where a wall
                closes the eastern side.
        """
        walls, ends = set[Segment](), dict[str, Cell]()
        for j, row in zip(reversed(range(CELLS)), rows, strict=True):
            for i in range(CELLS):
                mark, side = row[2 * i : 2 * i + 2]
                if mark.isalpha():
                    ends[mark.lower()] = (i, j)
                if (mark == "_" or mark.isupper()) and j > 0:
                    walls.add(Segment.beyond((i, j), Direction.SOUTH))
                if side == "|" and i < CELLS - 1:
                    walls.add(Segment.beyond((i, j), Direction.EAST))
        return Maze(walls=frozenset(walls), start=ends["s"], goal=ends["g"])

    def is_open(self, cell: Cell, direction: Direction) -> bool:
        """Whether the ball can pass from a cell to the next one."""
        within = all(0 <= k < CELLS for k in direction.next(cell))
        return within and Segment.beyond(cell, direction) not in self.walls

    def run(self, cell: Cell, direction: Direction) -> Cell:
        """Cell in which the ball comes to rest when the board is tilted in a direction."""
        while self.is_open(cell, direction):
            cell = direction.next(cell)
        return cell

    def stops(self, tilts: Iterable[Direction]) -> Iterator[Cell]:
        """Cells in which the ball comes to rest after each of some tilts, played from the start."""
        cell = self.start
        for tilt in tilts:
            cell = self.run(cell, tilt)
            yield cell

    def plan(self, cell: Cell) -> tuple[Direction, ...] | None:
        """Shortest sequence of tilts from a cell to the goal; None if it cannot be reached."""
        plans: dict[Cell, tuple[Direction, ...]] = {cell: ()}
        for here in (queue := [cell]):
            if here == self.goal:
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
        "s _|    g|    _ _ _ s|   |  _ _ g|  s _  |_  |    _  |_  |",
        " |  _| |_|   | |  _| |  _ _|  _| |   |  _  | |   | |_ _  |",
        " |_ _|_  |  _  |_ _ _|    _ _ _ _|  _|_  |_| |   | |  _| |",
        " |    _ _|   | |_    |   |   |_  |    _|_ _  |    _ _|  _|",
        "_ _|_ _ _|  _ _ _ _|G|  _ _|_ _ S|  _ _ _ _ G|  S _|_ _ G|",
    ),
    (
        "g   _ _  |  g  |  _ s|     |   | |   |  _ _ s|  g   _|   |",
        " |_|     |   | |_  | |  _| | | | |   | |   | |   | |  _| |",
        "_|   | | |  _|_  | | |    _| |  _|   |_| |_ _|   |_ _| | |",
        "  _|_|_| |    _ _|_| |   |  _|_  |    _|_  | |   | |  _| |",
        "S|_ _ _ _|  _ _ _ _ _|  G _ _ _|S|  G _ _ _ _|  _|_ _ _ S|",
    ),
)
"""The ten boards, five beside each other; see `Maze.parsed`."""
MAZES: tuple[Maze, ...] = tuple(
    Maze.parsed([row[start : start + 2 * CELLS] for row in rows])
    for rows in _MAP
    for start in range(0, len(rows[0]), _WIDTH)
)
"""The ten boards of the task."""
