import itertools
from functools import reduce

import pytest

from duobench.world.objects.mazes import (
    CELLS,
    CORNERS,
    MAZES,
    SEGMENTS,
    Cell,
    Direction,
    Maze,
    Segment,
)

CELLS_OF_A_BOARD = [(i, j) for i in range(CELLS) for j in range(CELLS)]


def turned(cell: Cell, turns: int, mirrored: bool) -> Cell:
    """Where a cell comes to lie when a board is turned by quarters, and mirrored before."""
    i, j = cell[::-1] if mirrored else cell
    for _ in range(turns):
        i, j = CELLS - 1 - j, i
    return i, j


def passages(maze: Maze, turns: int, mirrored: bool) -> frozenset[frozenset[Cell]]:
    """The pairs of cells between which nothing stands, on the board as it is turned."""
    return frozenset(
        frozenset(turned(end, turns, mirrored) for end in (cell, direction.next(cell)))
        for cell in CELLS_OF_A_BOARD
        for direction in Direction
        if maze.is_open(cell, direction)
    )


def reachable(maze: Maze, start: Cell, directions: tuple[Direction, ...]) -> set[Cell]:
    """Cells that steps in the given directions lead to."""
    found = [start]
    for cell in found:
        steps = [d.next(cell) for d in directions if maze.is_open(cell, d)]
        found += [step for step in steps if step not in found]
    return set(found)


def test_there_are_ten_mazes_and_no_two_are_alike_however_they_are_turned() -> None:
    assert len(MAZES) == 10
    turns = list(itertools.product(range(4), (False, True)))
    for one, other in itertools.combinations(MAZES, 2):
        assert all(passages(one, *turn) != passages(other, 0, False) for turn in turns)


def test_every_board_has_other_corners_for_start_and_goal() -> None:
    ends = [(maze.start, maze.goal) for maze in MAZES]
    assert len(set(ends)) == len(ends)
    assert all(start != goal for start, goal in ends)
    assert {start for start, _ in ends} == {goal for _, goal in ends} == set(CORNERS)
    # Side by side and across.
    assert {sum(a != b for a, b in zip(*pair, strict=True)) for pair in ends} == {1, 2}


def test_a_maze_is_a_tree_over_all_cells() -> None:
    for maze in MAZES:
        assert maze.walls <= set(SEGMENTS)
        assert reachable(maze, maze.start, tuple(Direction)) == set(CELLS_OF_A_BOARD)
        assert len(SEGMENTS) - len(maze.walls) == CELLS**2 - 1


def test_tilts_bring_the_ball_from_every_cell_to_the_goal() -> None:
    for maze, cell in itertools.product(MAZES, CELLS_OF_A_BOARD):
        plan = maze.plan(cell)
        assert plan is not None
        assert reduce(maze.run, plan, cell) == maze.goal


def test_the_way_from_the_start_takes_seven_or_eight_runs_and_no_single_diagonal_tilt() -> None:
    east_west, north_south = list(Direction)[::2], list(Direction)[1::2]
    diagonals = list(itertools.product(east_west, north_south))
    for maze in MAZES:
        assert 7 <= len(maze.plan(maze.start)) <= 8
        assert all(maze.goal not in reachable(maze, maze.start, pair) for pair in diagonals)


def test_a_ball_runs_until_a_wall_stops_it() -> None:
    maze = Maze.parsed(
        (
            "        g|",
            "         |",
            "  _      |",
            "     |   |",
            "S _ _ _ _|",
        )
    )
    assert (maze.start, maze.goal) == ((0, 0), (4, 4))
    assert maze.run((0, 0), Direction.EAST) == (4, 0)
    assert maze.run((0, 1), Direction.EAST) == (2, 1)
    assert maze.run((4, 1), Direction.WEST) == (3, 1)
    assert maze.run((1, 0), Direction.NORTH) == (1, 1)
    assert maze.run((1, 4), Direction.SOUTH) == (1, 2)
    assert maze.plan((3, 2)) == (Direction.EAST, Direction.NORTH)
    tilts = (Direction.NORTH, Direction.NORTH, Direction.EAST, Direction.SOUTH)
    assert list(maze.stops(tilts)) == [(0, 4), (0, 4), (4, 4), (4, 0)]


def test_a_letter_in_a_drawing_says_whether_a_wall_closes_the_southern_side() -> None:
    rows = ("         |", "  _      |", "    s   G|", "         |", "_ _ _ _ _|")
    maze = Maze.parsed(rows)
    assert (maze.start, maze.goal) == ((2, 2), (4, 2))
    assert maze.is_open((2, 2), Direction.SOUTH)
    assert not maze.is_open((4, 2), Direction.SOUTH)
    assert len(maze.walls) == 2


def test_a_maze_that_shuts_the_goal_in_has_no_plan() -> None:
    goal = (4, 4)
    walls = frozenset(
        Segment.beyond(goal, direction) for direction in (Direction.WEST, Direction.SOUTH)
    )
    assert Maze(walls=walls, start=(0, 0), goal=goal).plan((0, 0)) is None


def test_an_edge_is_the_same_from_both_sides() -> None:
    assert Segment.beyond((1, 2), Direction.EAST) == Segment.beyond((2, 2), Direction.WEST)
    assert Segment.beyond((1, 2), Direction.NORTH) == Segment.beyond((1, 3), Direction.SOUTH)


def test_a_drawing_needs_every_row() -> None:
    with pytest.raises(ValueError, match="shorter"):
        Maze.parsed(("         |",))
