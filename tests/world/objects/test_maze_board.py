import itertools

import manifold3d
import numpy as np
import pytest

from duobench.tasks import catalog
from duobench.world.objects import Image
from duobench.world.objects.maze_board import (
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
    wall_variants,
)
from duobench.world.objects.mazes import CELLS, CORNERS, MAZES, SEGMENTS, Direction, Maze, Segment
from duobench.world.objects.solid import (
    PLA_DENSITY,
    manifold_from,
    mass_properties,
    printable,
    union_of,
)

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


@mazes
def test_every_printed_board_weighs_what_the_simulated_one_does(maze: Maze) -> None:
    print_mass = mass_properties(printable_board(maze)).mass
    assert print_mass == pytest.approx(mass_properties(board()).mass, rel=1e-6)
    volume = manifold_from(printable(printable_board(maze))).volume()
    assert print_mass == pytest.approx(volume * PLA_DENSITY)


def shown(maze: Maze) -> list[Image]:
    hidden = wall_variants()[str(MAZES.index(maze))].without_images
    return [image for index, image in enumerate(board().images) if index not in hidden]


@pytest.mark.long
@mazes
def test_only_start_and_goal_of_a_board_are_coloured(maze: Maze) -> None:
    colours = {}
    for corner in CORNERS:
        # The corner's floor is all that is within its cell and not higher than the floor.
        (image,) = (
            image
            for image in shown(maze)
            if np.abs(image.mesh.vertices[:, :2] - cell_centre(corner)).max() < 0.51 * PITCH
        )
        colours[corner] = image.rgba
    plain = {colour for corner, colour in colours.items() if corner not in (maze.start, maze.goal)}
    assert len(plain) == 1
    assert colours[maze.start][1] == max(colours[maze.start][:3])
    assert colours[maze.goal][0] > 2 * max(colours[maze.goal][1:3])
    assert len({*plain, colours[maze.start], colours[maze.goal]}) == 3


@pytest.mark.slow
@mazes
def test_the_shown_images_are_the_board_without_two_faces_in_one_place(maze: Maze) -> None:
    images = [manifold_from(image.mesh) for image in shown(maze)]
    whole = manifold3d.Manifold.batch_boolean(images, manifold3d.OpType.Add)
    exact = union_of(printable_board(maze).shapes)
    assert (whole - exact).volume() == pytest.approx(0.0, abs=1e-12)
    assert (exact - whole).volume() == pytest.approx(0.0, abs=1e-12)
    # Walls reach into the floor; nothing else overlaps.
    *rest, walls = images
    for one, other in itertools.combinations(rest, 2):
        assert (one ^ other).volume() == pytest.approx(0.0, abs=1e-12)
    assert walls.bounding_box()[5] == pytest.approx(WALL_HEIGHT)


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
