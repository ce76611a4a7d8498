import numpy as np
import pytest

from tests.tools.meshes.shapes import box, grid
from tools.meshes.geometry import Mesh
from tools.meshes.quadrics import border_edges, minimise, scatter, surface_quadrics
from tools.meshes.topology import with_part


def quadrics(mesh: Mesh, border_weight: float = 1.0) -> np.ndarray:
    return surface_quadrics(mesh.vertices, with_part(mesh.faces, 0), border_weight)


def test_the_planes_at_a_corner_meet_in_the_corner():
    mesh = box((1.0, 2.0, 3.0))
    point, error = minimise(quadrics(mesh), mesh.vertices)
    np.testing.assert_allclose(point, mesh.vertices, atol=1e-12)
    np.testing.assert_allclose(error, 0.0, atol=1e-12)


def test_the_error_is_the_weighted_squared_distance():
    plate = grid(1, 1, 1.0)
    # No border: what counts is the height over the plate, with a third of the area at a corner.
    whole = quadrics(plate, border_weight=0.0).sum(axis=0, keepdims=True)
    height = 0.5
    xx, _, _, _, yy, _, _, zz, _, one = whole[0]
    assert (xx, yy, one) == (0.0, 0.0, 0.0)
    assert zz * height**2 == pytest.approx(1.0 * height**2)


def test_free_directions_are_settled_by_the_given_point():
    plate = quadrics(grid(1, 1, 1.0), border_weight=0.0)[:1]
    point, _ = minimise(plate, np.array([(0.3, 0.4, 0.0)]))
    np.testing.assert_allclose(point, [(0.3, 0.4, 0.0)], atol=1e-12)


def test_border_edges_are_found_for_every_part():
    plate = grid(1, 2, 1.0)
    one = with_part(plate.faces, 0)
    start, end, _ = border_edges(one)
    assert len(start) == 6
    middle = plate.vertices[:, 0].mean()
    centre = plate.vertices[plate.faces].mean(axis=1)
    two = with_part(plate.faces, (centre[:, 0] > middle).astype(int))
    start, end, face = border_edges(two)
    assert len(start) == 8  # the edge between the parts counts once for each
    assert sorted(two[face, 3]) == [0] * 4 + [1] * 4
    assert len({*zip(start.tolist(), end.tolist(), strict=True)}) == 8


def test_rows_are_added_by_index():
    total = scatter(np.array([2, 0, 2]), np.array([(1.0, 2.0), (3.0, 4.0), (5.0, 6.0)]), 4)
    np.testing.assert_array_equal(total, [(3, 4), (0, 0), (6, 8), (0, 0)])
