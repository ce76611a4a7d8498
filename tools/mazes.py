"""Prove that the boards of ball_maze cannot be won blindly.

`python -m tools.mazes` prints the most boards that one sequence of tilts solves: where any stop in
the goal counts, and where the ball must rest there, as the task asks.

A blind player sends the same tilts to every board. Its positions on some boards together are the
states of one automaton, which a breadth-first search explores exactly; a solved board stays solved.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from duobench.objects.mazes import MAZES, Direction, Maze

MAX_TILTS = 19
"""Tilts of 14 control steps for which there is time in an episode after the lift."""
Numbers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Game:
    """Where the ball of one board can be: states are numbers from 0, at first 0, solved the last.

    A ball that must rest is in the goal after two tilts in a row. A rest of one tilt's length is
    that tilt once more, which moves no ball on any board. Otherwise any stop in the goal solves the
    board, which is never harder.
    """

    tilts: Numbers
    """The state after each tilt (4, n)."""
    distance: Numbers
    """Tilts (n,) from each state that any sequence needs at least to solve the board."""

    @staticmethod
    def of(maze: Maze, *, rests: bool) -> Game:
        """The states of a board on which the ball must rest in the goal, or only stop there."""
        states = [maze.start]
        for cell in states:
            ends = (maze.run(cell, tilt) for tilt in Direction)
            states += [end for end in dict.fromkeys(ends) if end not in states]
        solved = len(states)
        tilts = np.full((len(Direction), solved + 1), solved)
        for row, tilt in enumerate(Direction):
            for number, cell in enumerate(states):
                end = maze.run(cell, tilt)
                if not (end == maze.goal and (cell == maze.goal or not rests)):
                    tilts[row, number] = states.index(end)
        distance = np.full(solved + 1, MAX_TILTS + 1)
        distance[solved] = 0
        for _ in range(solved):
            distance = np.minimum(distance, 1 + distance[tilts].min(axis=0))
        return Game(tilts, distance)


def fewest_tilts(games: Sequence[Game], limit: int = MAX_TILTS) -> int | None:
    """Length of a shortest sequence that solves all boards; None if it is above a limit."""
    sizes = tuple(len(game.distance) for game in games)
    seen = np.zeros(math.prod(sizes), dtype=bool)
    level = np.zeros(1, dtype=np.int64)
    for count in range(limit + 1):
        if seen[-1]:
            return count
        states = np.unravel_index(level, sizes)
        ends = [game.tilts[:, at].ravel() for game, at in zip(games, states, strict=True)]
        needed = np.max([game.distance[at] for game, at in zip(games, ends, strict=True)], axis=0)
        ends = [at[needed < limit - count] for at in ends]
        found = np.unique(np.ravel_multi_index(ends, sizes))
        level = found[~seen[found]]
        seen[level] = True
    return None


def most_solved(mazes: Iterable[Maze], *, rests: bool) -> tuple[int, int]:
    """How many boards one sequence can solve, and the fewest tilts that solve so many."""
    games = [Game.of(maze, rests=rests) for maze in mazes]
    best = 0, 0
    for count in range(1, len(games) + 1):
        fewest = [fewest_tilts(some) for some in combinations(games, count)]
        if not (solved := [tilts for tilts in fewest if tilts is not None]):
            break
        best = count, min(solved)
    return best


if __name__ == "__main__":
    for must_rest, what in ((False, "stops"), (True, "rests")):
        boards, tilts = most_solved(MAZES, rests=must_rest)
        print(
            f"The ball {what} in the goal of {boards} boards at most, for which {tilts} tilts do."
        )
