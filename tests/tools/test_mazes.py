"""How many boards a fixed sequence of tilts wins in time: an exact search in a model."""

import pytest

from dev.tools.mazes import TIME, Game, fewest_steps, most_solved, price
from duobench.tasks.experts.scripts.blind import TILTS
from duobench.world.objects.mazes import MAZES, Direction, Maze

MOST = {(3, 5, 6, 7, 8): 287, (2, 5, 6, 7, 8): 293}
"""The largest sets of boards that one sequence solves with the ball at rest, and its steps."""
BLIND_BOARDS = (3, 5, 6, 7, 8)


def priced(mazes: list[Maze], tilts: tuple[Direction, ...]) -> int | None:
    """Control steps until the ball rests in the goal of all boards; None if it never does."""
    cells = [maze.start for maze in mazes]
    steps, open_ = 0, set(range(len(mazes)))
    for tilt in tilts:
        longest = 0
        for number in list(open_):
            maze, here = mazes[number], cells[number]
            end = maze.run(here, tilt)
            longest = max(longest, abs(end[0] - here[0]) + abs(end[1] - here[1]))
            cells[number] = end
            if (here, end) == (maze.goal, maze.goal):
                open_.discard(number)
        steps += int(price(longest))
        if not open_:
            return steps
    return None


@pytest.mark.long
def test_no_sequence_brings_the_ball_to_rest_on_more_than_five_boards() -> None:
    assert TIME == 301
    assert most_solved(MAZES, rests=True) == MOST


def test_the_blind_baseline_plays_a_cheapest_sequence_for_its_boards() -> None:
    mazes = [MAZES[number] for number in BLIND_BOARDS]
    tilts = tuple(tilt for tilt, _ in TILTS)
    cheapest = fewest_steps([Game.of(maze, rests=True) for maze in mazes])
    assert priced(mazes, tilts) == cheapest == MOST[BLIND_BOARDS]
    won = [n for n, maze in enumerate(MAZES) if priced([maze], tilts) is not None]
    assert set(BLIND_BOARDS) <= set(won)
    assert sum(steps for _, steps in TILTS) < TIME
