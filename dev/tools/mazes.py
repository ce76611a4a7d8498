"""Find how many boards of ball_maze can be won blindly, in control steps.

`python -m dev.tools.mazes` prints the most boards that one sequence of tilts solves in the time
that an
episode has, where the ball must rest in the goal, as the task asks, and where any stop counts.

A blind player sends the same tilts to every board. Its positions on some boards together are the
states of one automaton; a solved board stays solved. A tilt has a price in control steps, which
grows with the longest run on the boards that are not solved. The search is exact in this model, and
the model is no board: a real one may take less time, and lets a ball stop between two cells.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from duobench.tasks.catalog import HORIZONS
from duobench.world.objects.mazes import MAZES, Direction, Maze

TILT_STEPS, CELL_STEPS = 10, 3
"""Control steps of a tilt whose longest run is one cell, or none, and of each further cell. It is a
price, not a bound: hands that tilt a little faster were seen to win the boards of a sequence at 9
and 2, and none that won more than five."""
LIFTED = 49
"""Control steps after which quick hands have the board in the air."""
TIME = HORIZONS["ball_maze"] - LIFTED
"""Control steps that an episode has for tilts."""
FEW = 3
"""For so many boards together, the way from every state is computed."""
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
    runs: Numbers
    """How many cells the ball rolls in each tilt (4, n); 0 where the board is solved."""

    @staticmethod
    def of(maze: Maze, *, rests: bool) -> Game:
        """The states of a board on which the ball must rest in the goal, or only stop there."""
        states = [maze.start]
        for cell in states:
            ends = (maze.run(cell, tilt) for tilt in Direction)
            states += [end for end in dict.fromkeys(ends) if end not in states]
        solved = len(states)
        tilts = np.full((len(Direction), solved + 1), solved)
        runs = np.zeros_like(tilts)
        for row, tilt in enumerate(Direction):
            for number, cell in enumerate(states):
                end = maze.run(cell, tilt)
                runs[row, number] = abs(end[0] - cell[0]) + abs(end[1] - cell[1])
                if not (end == maze.goal and (cell == maze.goal or not rests)):
                    tilts[row, number] = states.index(end)
        return Game(tilts, runs)


def price(longest: Numbers) -> Numbers:
    """Control steps (n,) of tilts, by the longest run of each (n,) in cells."""
    return TILT_STEPS + CELL_STEPS * np.maximum(longest - 1, 0)


class Together:
    """Some games at once: joint states are numbers, at first 0, all solved the last."""

    def __init__(self, games: Sequence[Game]) -> None:
        """Count the states.

        Args:
            games: The games.
        """
        self._games = games
        self._sizes = tuple(game.tilts.shape[1] for game in games)
        self.count = math.prod(self._sizes)
        """How many joint states there are."""

    def tilted(
        self, states: Numbers
    ) -> Iterable[tuple[list[Numbers], Numbers, Numbers]]:
        """For each tilt: states of each game, joint states and price of it, from joint states."""
        at = np.unravel_index(states, self._sizes)
        for row in range(len(Direction)):
            ends = [
                game.tilts[row, here]
                for game, here in zip(self._games, at, strict=True)
            ]
            runs = [
                game.runs[row, here] for game, here in zip(self._games, at, strict=True)
            ]
            yield (
                ends,
                np.asarray(np.ravel_multi_index(ends, self._sizes)),
                price(np.max(runs, axis=0)),
            )

    def left(self) -> Numbers:
        """Control steps from each joint state (n,) until all are solved, at least."""
        ways = [(ends, cost) for _, ends, cost in self.tilted(np.arange(self.count))]
        left = np.full(self.count, np.iinfo(np.int64).max // 2)
        left[-1] = 0
        while True:
            nearer = np.min([left, *(cost + left[ends] for ends, cost in ways)], axis=0)
            if (nearer == left).all():
                return left
            left = nearer


def fewest_steps(games: Sequence[Game], limit: int = TIME) -> int | None:
    """Control steps of a cheapest sequence that solves all boards; None if it is above a limit."""
    together = Together(games)
    few = [
        (some, *_left_of(games, some)) for some in combinations(range(len(games)), FEW)
    ]
    seen = np.zeros(together.count, dtype=bool)
    waiting = defaultdict(list, {0: [np.zeros(1, dtype=np.int64)]})
    for steps in range(limit + 1):
        if steps not in waiting:
            continue
        level = np.unique(np.concatenate(waiting.pop(steps)))
        level = level[~seen[level]]
        seen[level] = True
        if seen[-1]:
            return steps
        for ends, joint, cost in together.tilted(level):
            due = steps + cost
            in_time = due <= limit
            for some, left, sizes in few:
                part = np.ravel_multi_index([ends[number] for number in some], sizes)
                in_time &= due + left[part] <= limit
            for at in np.unique(due[in_time]):
                waiting[int(at)].append(joint[in_time & (due == at)])
    return None


_left: dict[tuple[Game, ...], Numbers] = {}


def _left_of(
    games: Sequence[Game], some: tuple[int, ...]
) -> tuple[Numbers, tuple[int, ...]]:
    """What is left for some of the games, and how many states each has; computed once."""
    chosen = tuple(games[number] for number in some)
    if chosen not in _left:
        _left[chosen] = Together(chosen).left()
    return _left[chosen], tuple(game.tilts.shape[1] for game in chosen)


def most_solved(mazes: Sequence[Maze], *, rests: bool) -> dict[tuple[int, ...], int]:
    """The largest sets of boards that one sequence solves in time, each with the steps it takes."""
    games = [Game.of(maze, rests=rests) for maze in mazes]
    best: dict[tuple[int, ...], int] = {}
    for count in range(1, len(games) + 1):
        found = {}
        for some in combinations(range(len(games)), count):
            # What solves more boards solves all but one of them too.
            if count == 1 or all(
                fewer in best for fewer in combinations(some, count - 1)
            ):
                steps = fewest_steps([games[number] for number in some])
                if steps is not None:
                    found[some] = steps
        if not found:
            break
        best = found
    return best


if __name__ == "__main__":
    for must_rest, what in ((True, "rests"), (False, "stops")):
        sets = most_solved(MAZES, rests=must_rest)
        most = len(next(iter(sets)))
        told = ", ".join(f"{boards} in {steps}" for boards, steps in sets.items())
        print(
            f"In {TIME} steps the ball {what} in the goal of {most} boards at most: {told}."
        )
