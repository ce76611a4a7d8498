"""The baseline of ball_maze that does not look."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from duobench.tasks.ball_maze import TASK
from duobench.tasks.experts.scripts.blind import TILTS, ball_maze
from duobench.world.objects.mazes import MAZES
from tests.task_harness import TaskHarness

RESTING = [
    str(number)
    for number, maze in enumerate(MAZES)
    if (maze.goal, maze.goal) in itertools.pairwise(maze.stops(tilt for tilt, _ in TILTS))
]
"""The boards on which the sequence brings the ball to rest in the goal."""


@pytest.fixture(scope="module")
def bench() -> TaskHarness:
    return TaskHarness(TASK)


def commands(bench: TaskHarness, board: str) -> Iterator[np.ndarray]:
    """What the arms are commanded at each control step, with a board where it is on seed 0."""
    layout = TASK.arrange(replace(bench.start(0), variants={"board": board}))
    bench.start(layout=layout)
    for _ in bench.steps(ball_maze, then=20):
        yield bench.sim.duo.command().flat


@pytest.mark.long
def test_it_does_the_same_whatever_the_maze_is(bench: TaskHarness) -> None:
    one, other = (list(commands(bench, board)) for board in ("0", "5"))
    assert len(one) <= TASK.horizon
    np.testing.assert_allclose(one, other, atol=0.01)


@pytest.mark.long
def test_it_lifts_the_board_and_wins_a_maze_that_its_sequence_solves(bench: TaskHarness) -> None:
    stages = set()
    for board in RESTING:
        assert len(list(commands(bench, board))) <= TASK.horizon
        stages.add(bench.stage)
    assert min(stages) >= 3
    assert max(stages) == 4
