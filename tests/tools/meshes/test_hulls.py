import numpy as np
import pytest
from scipy.spatial import ConvexHull

from duobench.errors import AssetError
from tests.tools.meshes.shapes import box, normals, open_edges, sphere, volume
from tools.meshes.geometry import to_grid
from tools.meshes.hulls import convex_hull


def assert_closed_and_convex(mesh):
    assert open_edges(mesh) == 0
    corner = mesh.vertices[mesh.faces[:, 0]]
    unit = normals(mesh) / np.linalg.norm(normals(mesh), axis=1, keepdims=True)
    height = unit @ mesh.vertices.T - (unit * corner).sum(axis=1, keepdims=True)
    assert height.max() < 1e-9


def test_a_box_is_found_among_points_inside_and_on_it():
    random = np.random.default_rng(0)
    inside = random.uniform(-0.5, 0.5, size=(500, 3)) * (0.1, 0.2, 0.3)
    faces = inside.copy()
    faces[:, 0] = 0.05
    points = np.concatenate([inside, faces, box((0.1, 0.2, 0.3)).vertices])
    hull = convex_hull(points, 24)
    assert len(hull.vertices) == 8
    assert len(hull.faces) == 12
    assert_closed_and_convex(hull)
    assert volume(hull) == pytest.approx(0.1 * 0.2 * 0.3)


@pytest.mark.parametrize("seed", range(5))
def test_without_a_limit_the_volume_is_that_of_the_true_hull(seed):
    points = np.random.default_rng(seed).normal(size=(80, 3)) * 0.1
    hull = convex_hull(points, 80)
    assert_closed_and_convex(hull)
    assert volume(hull) == pytest.approx(ConvexHull(points).volume, rel=1e-3)


@pytest.mark.parametrize("vertices", [4, 12, 24])
def test_a_limited_hull_uses_points_of_the_shape_and_grows_towards_it(vertices):
    ball = sphere(0.1)
    hull = convex_hull(ball.vertices, vertices)
    assert len(hull.vertices) == vertices
    assert_closed_and_convex(hull)
    known = {tuple(p) for p in to_grid(ball.vertices).tolist()}
    assert {tuple(p) for p in to_grid(hull.vertices).tolist()} <= known
    assert volume(hull) < volume(ball)
    assert volume(hull) < volume(convex_hull(ball.vertices, vertices + 4))


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_the_points_does_not_matter(seed):
    points = np.random.default_rng(seed).uniform(size=(300, 3))
    first = convex_hull(points, 24)
    second = convex_hull(points[::-1], 24)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_flat_points_have_no_hull():
    points = np.random.default_rng(0).uniform(size=(50, 3)) * (1.0, 1.0, 0.0)
    with pytest.raises(AssetError, match="one plane"):
        convex_hull(points, 24)
