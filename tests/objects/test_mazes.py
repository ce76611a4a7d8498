import itertools
from functools import reduce

import pytest

from duobench.objects.mazes import (
    CELLS,
    GOAL,
    MAZES,
    SEGMENTS,
    START,
    Cell,
    Direction,
    Maze,
    Segment,
)

CELLS_OF_A_BOARD = [(i, j) for i in range(CELLS) for j in range(CELLS)]


def mirrored(maze: Maze) -> Maze:
    """The maze with its axes exchanged, which leaves start and goal where they are."""
    return Maze(
        frozenset(Segment(wall.cell[::-1], along_x=not wall.along_x) for wall in maze.walls)
    )


def reachable(maze: Maze, start: Cell, directions: tuple[Direction, ...]) -> set[Cell]:
    """Cells that steps in the given directions lead to."""
    found = [start]
    for cell in found:
        steps = [d.next(cell) for d in directions if maze.is_open(cell, d)]
        found += [step for step in steps if step not in found]
    return set(found)


def test_there_are_ten_mazes_and_no_two_are_alike() -> None:
    assert len(MAZES) == 10
    assert len({m.walls for m in MAZES} | {mirrored(m).walls for m in MAZES}) == 20


def test_a_maze_is_a_tree_over_all_cells() -> None:
    for maze in MAZES:
        assert maze.walls <= set(SEGMENTS)
        assert reachable(maze, START, tuple(Direction)) == set(CELLS_OF_A_BOARD)
        assert len(SEGMENTS) - len(maze.walls) == CELLS**2 - 1


def test_tilts_bring_the_ball_from_every_cell_to_the_goal() -> None:
    for maze, cell in itertools.product(MAZES, CELLS_OF_A_BOARD):
        plan = maze.plan(cell)
        assert plan is not None
        assert reduce(maze.run, plan, cell) == GOAL


def test_the_way_from_the_start_takes_several_runs_and_more_than_one_diagonal_tilt() -> None:
    for maze in MAZES:
        assert 4 <= len(maze.plan(START)) <= 6
        assert GOAL not in reachable(maze, START, (Direction.NORTH, Direction.EAST))


def test_a_ball_runs_until_a_wall_stops_it() -> None:
    maze = Maze.parsed(
        (
            "         |",
            "         |",
            "  _      |",
            "     |   |",
            "_ _ _ _ _|",
        )
    )
    assert maze.run((0, 0), Direction.EAST) == (4, 0)
    assert maze.run((0, 1), Direction.EAST) == (2, 1)
    assert maze.run((4, 1), Direction.WEST) == (3, 1)
    assert maze.run((1, 0), Direction.NORTH) == (1, 1)
    assert maze.run((1, 4), Direction.SOUTH) == (1, 2)
    assert maze.plan((3, 2)) == (Direction.EAST, Direction.NORTH)


def test_a_maze_that_shuts_the_goal_in_has_no_plan() -> None:
    shut = Maze(
        frozenset(
            Segment.beyond(GOAL, direction) for direction in (Direction.WEST, Direction.SOUTH)
        )
    )
    assert shut.plan(START) is None


def test_an_edge_is_the_same_from_both_sides() -> None:
    assert Segment.beyond((1, 2), Direction.EAST) == Segment.beyond((2, 2), Direction.WEST)
    assert Segment.beyond((1, 2), Direction.NORTH) == Segment.beyond((1, 3), Direction.SOUTH)


def test_a_drawing_needs_every_row() -> None:
    with pytest.raises(ValueError, match="shorter"):
        Maze.parsed(("         |",))
