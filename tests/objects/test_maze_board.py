import numpy as np
import pytest

from duobench.errors import UnknownNameError
from duobench.objects.maze_board import (
    BALL_RADIUS,
    BAR,
    BASE,
    EDGE,
    GRIP_Z,
    PITCH,
    WALL,
    WALL_HEIGHT,
    ball,
    board,
    cell_at,
    cell_centre,
    printable_board,
    wall_numbers,
)
from duobench.objects.mazes import CELLS, MAZES, SEGMENTS, Direction, Maze, Segment
from duobench.objects.solid import PLA_DENSITY, manifold_from, mass_properties, printable
from duobench.tasks import catalog

mazes = pytest.mark.parametrize("maze", MAZES, ids=range(len(MAZES)))


@mazes
def test_a_printed_board_stands_on_its_rim_and_ends_at_its_grips(maze: Maze) -> None:
    heights = printable(printable_board(maze)).vertices[:, 2]
    assert (heights.min(), heights.max()) == pytest.approx((-BASE, GRIP_Z + BAR[2] / 2))


@mazes
def test_the_prop_prints_the_walls_of_its_maze_only(maze: Maze) -> None:
    props = catalog.get("ball_maze").props
    variants = {"board": str(MAZES.index(maze))}
    printed = [solid for prop in props for solid in prop.prints(variants)]
    assert repr(printed) == repr([printable_board(maze), ball()])


def test_without_its_maze_the_prop_prints_nothing() -> None:
    prop = catalog.get("ball_maze").props[0]
    with pytest.raises(UnknownNameError, match=r"variant of board '17'.*Known: 0, 1"):
        prop.prints({"board": "17"})


@mazes
def test_every_printed_board_weighs_what_the_simulated_one_does(maze: Maze) -> None:
    print_mass = mass_properties(printable_board(maze)).mass
    assert print_mass == pytest.approx(mass_properties(board()).mass, rel=1e-6)
    volume = manifold_from(printable(printable_board(maze))).volume()
    assert print_mass == pytest.approx(volume * PLA_DENSITY)


def test_the_ball_weighs_its_volume() -> None:
    exact = 4 / 3 * np.pi * BALL_RADIUS**3 * PLA_DENSITY
    assert mass_properties(ball()).mass == pytest.approx(exact, rel=0.01)


def test_the_ball_fits_through_the_corridors_and_meets_walls_below_their_top() -> None:
    assert 2 * BALL_RADIUS < PITCH - WALL
    assert BALL_RADIUS < WALL_HEIGHT


def test_a_wall_stands_between_the_cells_of_its_edge() -> None:
    shapes, numbers = board().shapes, wall_numbers()
    assert set(numbers) == set(SEGMENTS)
    assert sorted(numbers.values()) == list(range(len(shapes) - len(SEGMENTS), len(shapes)))
    for i in range(CELLS):
        for j in range(CELLS):
            for direction in (Direction.EAST, Direction.NORTH):
                other = direction.next((i, j))
                if max(other) >= CELLS:
                    continue
                wall = shapes[numbers[Segment.beyond((i, j), direction)]]
                between = np.mean([cell_centre((i, j)), cell_centre(other)], axis=0)
                assert wall.pose.translation[:2] == pytest.approx(between)
                thin = 0 if direction is Direction.EAST else 1
                assert wall.size[thin] == pytest.approx(WALL)
                assert wall.size[1 - thin] == pytest.approx(PITCH + WALL)


def test_points_belong_to_the_cell_around_them() -> None:
    for i in range(CELLS):
        for j in range(CELLS):
            x, y = cell_centre((i, j))
            assert cell_at(x + 0.45 * PITCH, y - 0.45 * PITCH) == (i, j)
    assert cell_at(-EDGE, EDGE) == (0, CELLS - 1)
