"""No fixed sequence of tilts wins most boards: proven by a search over all sequences."""

import itertools
from dataclasses import replace

import pytest

from duobench.experts.scripts.blind import TILTS
from duobench.objects.mazes import CELLS, MAZES, Direction, Maze
from tools.mazes import MAX_TILTS, Game, fewest_tilts, most_solved

MOST, MOST_AT_REST = 4, 3


def solves(maze: Maze, tilts: tuple[Direction, ...], *, rests: bool) -> bool:
    """Whether the ball stops in the goal, or is there after two tilts in a row."""
    stops = list(maze.stops(tilts))
    return (maze.goal, maze.goal) in itertools.pairwise(stops) if rests else maze.goal in stops


@pytest.mark.parametrize(("rests", "most"), [(False, MOST), (True, MOST_AT_REST)])
def test_no_sequence_of_19_tilts_solves_more_boards_than_it_may(rests: bool, most: int) -> None:
    assert MAX_TILTS == 19
    games = [Game.of(maze, rests=rests) for maze in MAZES]
    assert all(fewest_tilts(some) is None for some in itertools.combinations(games, most + 1))
    assert any(fewest_tilts(some) for some in itertools.combinations(games, most))


def test_the_blind_baseline_plays_a_best_sequence() -> None:
    won = sum(solves(maze, TILTS, rests=True) for maze in MAZES)
    assert (won, len(TILTS)) == most_solved(MAZES, rests=True)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("rests", [False, True])
def test_the_fewest_tilts_are_those_that_trying_all_finds(count: int, rests: bool) -> None:
    cells = list(itertools.product(range(CELLS), repeat=2))
    # From these starts two tilts reach the goal, so that all sequences can be tried.
    easy = [
        next(replace(maze, start=cell) for cell in cells if len(maze.plan(cell)) == 2)
        for maze in MAZES[:count]
    ]
    fewest = fewest_tilts([Game.of(maze, rests=rests) for maze in easy])
    assert fewest <= 8

    def solved(length: int) -> bool:
        sequences = itertools.product(Direction, repeat=length)
        return any(all(solves(maze, tilts, rests=rests) for maze in easy) for tilts in sequences)

    assert solved(fewest)
    assert not solved(fewest - 1)


def test_a_limit_is_kept_to() -> None:
    game = Game.of(MAZES[0], rests=False)
    runs = len(MAZES[0].plan(MAZES[0].start))
    assert fewest_tilts([game], runs) == runs
    assert fewest_tilts([game], runs - 1) is None
