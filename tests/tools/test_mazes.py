"""No fixed sequence of tilts wins most boards: proven by a search over all sequences."""

import itertools
import random
from functools import reduce

import pytest

from duobench.experts.blind import TILTS
from duobench.objects.mazes import CORNERS, MAZES, Direction, Maze
from tools.mazes import (
    MAX_TILTS,
    MOST,
    MOST_AT_REST,
    RUNS,
    Game,
    candidate,
    drawing,
    is_fair,
    most_solved,
    shortest,
    tree,
)


def stops(maze: Maze, tilts: tuple[Direction, ...]) -> bool:
    """Whether the ball stops in the goal after one of the tilts."""
    return maze.goal in maze.stops(tilts)


def rests(maze: Maze, tilts: tuple[Direction, ...]) -> bool:
    """Whether the ball is in the goal after two tilts in a row."""
    return (maze.goal, maze.goal) in itertools.pairwise(maze.stops(tilts))


def easy(rng: random.Random) -> Maze:
    """A maze that few tilts solve, so that all sequences can be tried."""
    while True:
        start, goal = rng.sample(CORNERS, 2)
        maze = Maze(walls=tree(rng), start=start, goal=goal)
        plan = maze.plan(start)
        if plan is not None and len(plan) == 2:
            return maze


@pytest.mark.parametrize(("at_rest", "most"), [(False, MOST), (True, MOST_AT_REST)])
def test_no_sequence_of_19_tilts_solves_more_boards_than_it_may(at_rest: bool, most: int) -> None:
    assert (MAX_TILTS, MOST) == (19, 4)
    games = [Game.of(maze, rests=at_rest) for maze in MAZES]
    sets = list(itertools.combinations(games, most + 1))
    assert len(sets) == {4: 252, 3: 210}[most]
    assert all(shortest(each) is None for each in sets)


@pytest.mark.parametrize(("at_rest", "solved"), [(False, stops), (True, rests)])
def test_the_best_sequence_solves_the_boards_that_it_claims(at_rest: bool, solved) -> None:
    numbers, tilts = most_solved(MAZES, rests=at_rest)
    assert len(tilts) <= MAX_TILTS
    assert tuple(n for n, maze in enumerate(MAZES) if solved(maze, tilts)) == numbers
    assert len(numbers) == (MOST_AT_REST if at_rest else MOST)


def test_the_blind_baseline_plays_a_best_sequence() -> None:
    won = [maze for maze in MAZES if rests(maze, TILTS)]
    assert len(won) == MOST_AT_REST
    assert len(TILTS) <= MAX_TILTS
    assert len(TILTS) == len(most_solved(MAZES, rests=True)[1])


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize(("at_rest", "solved"), [(False, stops), (True, rests)])
def test_a_shortest_sequence_is_the_one_that_trying_all_finds(
    count: int, at_rest: bool, solved
) -> None:
    rng = random.Random(count)
    mazes = [easy(rng) for _ in range(count)]
    found = shortest([Game.of(maze, rests=at_rest) for maze in mazes])
    assert found is not None
    assert all(solved(maze, found) for maze in mazes)
    assert len(found) <= 8
    for tilts in itertools.product(Direction, repeat=len(found) - 1):
        assert not all(solved(maze, tilts) for maze in mazes)


def test_a_limit_is_kept_to() -> None:
    game = Game.of(MAZES[0])
    runs = len(MAZES[0].plan(MAZES[0].start))
    assert len(shortest([game], runs)) == runs
    assert shortest([game], runs - 1) is None


def test_a_candidate_has_the_properties_of_a_board() -> None:
    rng = random.Random(0)
    for start, goal in itertools.permutations(CORNERS[:3], 2):
        maze = candidate(rng, start, goal)
        assert (maze.start, maze.goal) == (start, goal)
        assert len(maze.plan(start)) in RUNS
        assert is_fair(maze)
        assert reduce(maze.run, maze.plan(start), start) == goal


@pytest.mark.parametrize("maze", MAZES, ids=range(len(MAZES)))
def test_a_drawing_is_read_as_the_maze_that_was_drawn(maze: Maze) -> None:
    assert Maze.parsed(drawing(maze)) == maze
