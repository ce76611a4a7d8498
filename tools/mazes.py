"""Prove that the boards of ball_maze cannot be won blindly, and search for boards like that.

`python -m tools.mazes` prints the most boards that one sequence of tilts solves, and the sequence:
where any stop in the goal counts, and where the ball must rest there, as the task asks. `python -m
tools.mazes --search 1` looks for ten new boards from a seed, which takes minutes, and prints them
as `duobench.objects.mazes` has them.

A blind player sends the same tilts to every board. Its positions on some boards together are the
states of one automaton, which a breadth-first search explores exactly; a solved board stays solved.
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from duobench.objects.mazes import (
    CELLS,
    CORNERS,
    MAZES,
    SEGMENTS,
    Cell,
    Direction,
    Maze,
    Segment,
)

BOARDS = len(MAZES)
MAX_TILTS = 19
"""Tilts of 14 control steps for which there is time in an episode after the lift."""
MOST, MOST_AT_REST = 4, 3
"""On how many of the boards one sequence may bring the ball to a stop in the goal, and to rest
there."""
RUNS = (7, 8)
"""Length of the shortest plan of a board."""
TILTS = tuple(Direction)
Numbers = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Game:
    """Where the balls of one or more boards can be: states are numbers from 0."""

    tilts: Numbers
    """The state after each tilt (4, n); the last state is that all boards are solved."""
    start: int
    """The state before the first tilt."""
    distance: Numbers
    """Tilts (n,) from each state that any sequence needs at least to solve all boards."""

    @property
    def size(self) -> int:
        """Number of states."""
        return self.tilts.shape[1]

    @staticmethod
    def of(maze: Maze, *, rests: bool = False) -> Game:
        """The states of one board.

        Args:
            maze: The board.
            rests: Whether the ball must be in the goal after two tilts in a row. Otherwise any stop
                in the goal solves the board, which is never harder. A rest of one tilt's length is
                that tilt once more, which moves no ball on any board.
        """
        states = [maze.start]
        for cell in states:
            ends = (maze.run(cell, tilt) for tilt in TILTS)
            states += [end for end in dict.fromkeys(ends) if end not in states]
        solved = len(states)
        tilts = np.full((len(TILTS), solved + 1), solved, dtype=np.int32)
        for row, tilt in enumerate(TILTS):
            for number, cell in enumerate(states):
                end = maze.run(cell, tilt)
                if not (end == maze.goal and (cell == maze.goal or not rests)):
                    tilts[row, number] = states.index(end)
        distance = np.full(solved + 1, np.iinfo(np.int32).max // 2, dtype=np.int32)
        distance[solved] = 0
        for _ in range(solved):
            distance = np.minimum(distance, 1 + distance[tilts].min(axis=0))
        return Game(tilts, 0, distance)

    def beside(self, other: Game) -> Game:
        """The states of both together."""
        tilts = self.tilts[:, :, None] * other.size + other.tilts[:, None, :]
        distance = np.maximum(self.distance[:, None], other.distance)
        start = self.start * other.size + other.start
        return Game(tilts.reshape(len(TILTS), -1), start, distance.ravel())


def shortest(games: Sequence[Game], limit: int = MAX_TILTS) -> tuple[Direction, ...] | None:
    """A shortest sequence that solves all boards; None if it would be longer than a limit."""
    # Two halves, whose tables are small: a state is `state of the one * size + state of the other`.
    half = (len(games) + 1) // 2
    one = reduce(Game.beside, games[:half])
    other = reduce(Game.beside, games[half:], Game(np.zeros((4, 1), np.int32), 0, np.zeros(1, int)))
    size = other.size
    seen = np.zeros(one.size * size, dtype=bool)
    place = np.zeros(seen.size, dtype=np.int32)
    levels = [np.array([one.start * size + other.start], dtype=np.int32)]
    while len(levels[-1]) and not seen[-1] and len(levels) <= limit:
        first, second = np.divmod(levels[-1], size)
        left = limit - len(levels)
        found = []
        for row in range(len(TILTS)):
            states = one.tilts[row][first] * size + other.tilts[row][second]
            new = ~seen[states]
            new &= (one.distance[states // size] <= left) & (other.distance[states % size] <= left)
            states = states[new]
            seen[states] = True
            place[states] = np.arange(len(states))
            found.append(states[place[states] == np.arange(len(states))])
        levels.append(np.concatenate(found))
    return _way_back(one, other, levels) if seen[-1] else None


def _way_back(one: Game, other: Game, levels: list[Numbers]) -> tuple[Direction, ...]:
    """The tilts that lead through the levels of a search to the state in which all are solved."""
    way: list[Direction] = []
    state = one.size * other.size - 1
    for level in reversed(levels[:-1]):
        first, second = np.divmod(level, other.size)
        ends = one.tilts[:, first] * other.size + other.tilts[:, second]
        row, number = np.argwhere(ends == state)[0]
        way.append(TILTS[row])
        state = level[number]
    return tuple(reversed(way))


def most_solved(
    mazes: Iterable[Maze], *, rests: bool = False
) -> tuple[tuple[int, ...], tuple[Direction, ...]]:
    """The largest set of boards that one sequence solves, and the shortest sequence that does.

    Args:
        mazes: The boards.
        rests: Whether the ball must rest; see `Game.of`.

    Returns:
        Numbers of the boards, and the tilts.
    """
    games = [Game.of(maze, rests=rests) for maze in mazes]
    best: tuple[tuple[int, ...], tuple[Direction, ...]] = (), ()
    for count in range(1, len(games) + 1):
        sets = combinations(range(len(games)), count)
        ways = ((numbers, shortest([games[n] for n in numbers])) for numbers in sets)
        solved = [(numbers, way) for numbers, way in ways if way is not None]
        if not solved:
            break
        best = min(solved, key=lambda each: len(each[1]))
    return best


def search(seed: int) -> list[Maze]:
    """Ten boards that no sequence solves more of than `MOST` and `MOST_AT_REST`.

    One board after the other is replaced by another one, if no more sets of boards that are too
    large are solved by one sequence then.
    """
    rng = random.Random(seed)
    pairs = rng.sample(list(permutations(CORNERS, 2)), BOARDS)
    mazes = [candidate(rng, *pair) for pair in pairs]
    counts = [_solved_with(mazes, number) for number in range(BOARDS)]
    while any(counts):
        (number,) = rng.choices(range(BOARDS), counts)
        maze = candidate(rng, mazes[number].start, mazes[number].goal)
        changed = [*mazes[:number], maze, *mazes[number + 1 :]]
        if _solved_with(changed, number, counts[number]) <= counts[number]:
            mazes = changed
            counts = [_solved_with(mazes, each) for each in range(BOARDS)]
            print(f"still too easy: {sum(counts)}", flush=True)
    return mazes


def _solved_with(mazes: Sequence[Maze], number: int, enough: int | None = None) -> int:
    """How many sets of too many boards with one of them are solved; counts little beyond enough."""
    count = 0
    for rests, most in ((True, MOST_AT_REST), (False, MOST)):
        games = [Game.of(maze, rests=rests) for maze in mazes]
        one = games.pop(number)
        for others in combinations(games, most):
            count += shortest([one, *others]) is not None
            if enough is not None and count > enough:
                return count
    return count


def candidate(rng: random.Random, start: Cell, goal: Cell) -> Maze:
    """A random maze with the properties of a single board."""
    while True:
        maze = Maze(walls=tree(rng), start=start, goal=goal)
        plan = maze.plan(start)
        if plan is not None and len(plan) in RUNS and is_fair(maze):
            return maze


def is_fair(maze: Maze) -> bool:
    """Whether tilts lead from everywhere to the goal, and from the start no single diagonal one."""
    cells = ((i, j) for i in range(CELLS) for j in range(CELLS))
    diagonals = zip(TILTS, (*TILTS[1:], TILTS[0]), strict=True)
    return all(maze.plan(cell) is not None for cell in cells) and not any(
        maze.goal in reached(maze, maze.start, pair) for pair in diagonals
    )


def reached(maze: Maze, start: Cell, directions: Iterable[Direction]) -> set[Cell]:
    """Cells that steps in the given directions lead to."""
    directions = tuple(directions)
    cells = [start]
    for cell in cells:
        steps = [way.next(cell) for way in directions if maze.is_open(cell, way)]
        cells += [step for step in steps if step not in cells]
    return set(cells)


def tree(rng: random.Random) -> frozenset[Segment]:
    """The walls of a random tree over all cells: a walk that goes on from one of its cells."""
    straightness = rng.random()
    growing = [(rng.randrange(CELLS), rng.randrange(CELLS))]
    seen, walls = set(growing), set(SEGMENTS)
    while growing:
        cell = growing[-1] if rng.random() < straightness else rng.choice(growing)
        ways = [
            way
            for way in TILTS
            if all(0 <= k < CELLS for k in way.next(cell)) and way.next(cell) not in seen
        ]
        if not ways:
            growing.remove(cell)
            continue
        way = rng.choice(ways)
        walls.remove(Segment.beyond(cell, way))
        seen.add(way.next(cell))
        growing.append(way.next(cell))
    return frozenset(walls)


def drawing(maze: Maze) -> list[str]:
    """The rows of text that `Maze.parsed` reads."""
    rows = []
    for j in reversed(range(CELLS)):
        row = ""
        for i in range(CELLS):
            cell = i, j
            mark = {maze.start: "s", maze.goal: "g"}.get(cell)
            shut = not maze.is_open(cell, Direction.SOUTH)
            row += ("_" if shut else " ") if mark is None else mark.upper() if shut else mark
            row += " " if maze.is_open(cell, Direction.EAST) else "|"
        rows.append(row)
    return rows


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.mazes", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--search", type=int, metavar="SEED", help="look for ten new boards")
    given = parser.parse_args()
    mazes = MAZES if given.search is None else search(given.search)
    if given.search is not None:
        for row in zip(*map(drawing, mazes), strict=True):
            print("  ".join(row))
    for rests, what in ((False, "stops"), (True, "rests")):
        numbers, way = most_solved(mazes, rests=rests)
        letters = " ".join(tilt.name[0] for tilt in way)
        boards = ", ".join(map(str, numbers))
        print(f"The ball {what} in the goal of {len(numbers)} boards ({boards}) by {letters}.")


if __name__ == "__main__":
    main()
