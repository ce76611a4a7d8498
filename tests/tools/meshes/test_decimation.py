import numpy as np
import pytest

from tests.tools.meshes.shapes import area, box, grid, normals, open_edges, shuffled, sphere, volume
from tools.meshes.decimation import Part, decimate
from tools.meshes.geometry import Mesh


def alone(mesh: Mesh, triangles: int, cell: float = 0.0, fill: float = 0.0) -> Mesh:
    return decimate([Part(mesh=mesh, fill=fill)], triangles=triangles, cell=cell)[0]


def test_a_ball_stays_round_and_closed_within_the_budget():
    light = alone(sphere(0.1), 200)
    assert len(light.faces) <= 200
    assert open_edges(light) == 0
    radius = np.linalg.norm(light.vertices, axis=1)
    assert radius.min() > 0.097
    assert radius.max() < 0.105
    assert volume(light) == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.03)
    outward = (normals(light) * light.vertices[light.faces].mean(axis=1)).sum(axis=1)
    assert (outward > 0).all()


def test_flat_sides_and_sharp_edges_survive_any_reduction():
    detailed = grid(20, 20, 0.005)
    light = alone(detailed, 2)
    assert area(light) == pytest.approx(area(detailed), rel=0.01)
    assert len(light.faces) == 2
    np.testing.assert_allclose(light.vertices[:, 2], 0.0)


def test_a_mesh_within_the_budget_stays_whole():
    crate = box((0.1, 0.2, 0.3))
    light = alone(crate, 12)
    assert len(light.faces) == 12
    assert volume(light) == pytest.approx(volume(crate))


@pytest.mark.parametrize("seed", range(4))
def test_the_order_of_the_input_does_not_matter(seed):
    detailed = sphere(0.1, rings=20, sectors=30)
    first = alone(detailed, 100, cell=0.004)
    second = alone(shuffled(detailed, seed), 100, cell=0.004)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_parts_that_touch_keep_one_border():
    ball = sphere(0.1)
    upper = ball.vertices[ball.faces].mean(axis=1)[:, 2] > 0.03
    halves = [
        Part(mesh=Mesh(vertices=ball.vertices, faces=ball.faces[side]), fill=0.0)
        for side in (upper, ~upper)
    ]
    light = decimate(halves, triangles=160, cell=0.003)
    whole = Mesh(
        vertices=np.concatenate([part.vertices for part in light]),
        faces=np.concatenate([light[0].faces, light[1].faces + len(light[0].vertices)]),
    )
    assert len(whole.faces) <= 160
    assert open_edges(light[0]) == open_edges(light[1]) > 0
    assert open_edges(whole) == 0


def test_what_is_smaller_than_a_cell_goes():
    crumb = sphere(0.0004)
    ball = sphere(0.1)
    both = Mesh(
        vertices=np.concatenate([ball.vertices, crumb.vertices + 0.201]),
        faces=np.concatenate([ball.faces, crumb.faces + len(ball.vertices)]),
    )
    light = alone(both, 10_000, cell=0.002)
    assert light.vertices.max() < 0.11


def test_small_holes_are_closed_before_the_budget_is_spent():
    plate = grid(20, 20, 0.005)
    centre = plate.vertices[plate.faces].mean(axis=1)[:, :2]
    hole = (np.abs(centre - 0.05) < 0.005).all(axis=1)
    holed = Mesh(vertices=plate.vertices, faces=plate.faces[~hole])
    assert area(alone(holed, 2, fill=0.05)) == pytest.approx(area(plate), rel=0.01)
    assert area(alone(holed, 16)) == pytest.approx(area(holed), rel=0.01)
