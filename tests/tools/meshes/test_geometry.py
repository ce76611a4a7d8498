import struct

import numpy as np
import pytest

from duobench.errors import AssetError
from tests.tools.meshes.shapes import shuffled, sphere
from tools.meshes.geometry import canonical, from_grid, read, to_grid

OBJ = b"""# comment
o part
v 0.0 0.0 0.0
v 1.0 0.0 0.0
v 0.0 1.0 0.5
v 0.0 0.0 -2e-1
vn 0.0 0.0 1.0
f 1//1 2//1 3//1
f 2/1/1 4/2/1 3/3/1
"""


def stl(corners: np.ndarray) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 1, *triangle.ravel(), 0) for triangle in corners]
    return b"solid of an exporter".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def test_obj_positions_and_faces_are_read():
    mesh = read("part.obj", OBJ)
    np.testing.assert_array_equal(mesh.vertices[3], (0.0, 0.0, -0.2))
    np.testing.assert_array_equal(mesh.faces, [(0, 1, 2), (1, 3, 2)])


def test_stl_triangles_are_read():
    corners = np.arange(18, dtype=np.float32).reshape(2, 3, 3)
    mesh = read("part.stl", stl(corners))
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], corners)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("part.ply", b""),
        ("part.obj", b"v 0 0 0\n"),
        ("part.obj", OBJ + b"f 1 2 3 4\n"),
        ("part.obj", OBJ + b"f 1 2 9\n"),
        ("part.stl", b"solid ascii\nendsolid\n"),
        ("part.stl", stl(np.zeros((2, 3, 3)))[:-1]),
    ],
)
def test_other_content_is_refused_by_name(name, data):
    with pytest.raises(AssetError, match=name):
        read(name, data)


def test_meshes_cannot_be_written_to():
    mesh = sphere(1.0)
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        mesh.faces[0, 0] = 1


def test_the_grid_is_kept_exactly():
    points = np.random.default_rng(0).integers(-(10**6), 10**6, size=(1000, 3))
    np.testing.assert_array_equal(to_grid(from_grid(points)), points)


@pytest.mark.parametrize("seed", range(5))
def test_canonical_form_does_not_depend_on_the_order(seed):
    mesh = sphere(0.1)
    other = shuffled(mesh, seed)
    first = canonical(to_grid(mesh.vertices), mesh.faces)
    second = canonical(to_grid(other.vertices), other.faces)
    np.testing.assert_array_equal(first.vertices, second.vertices)
    np.testing.assert_array_equal(first.faces, second.faces)


def test_canonical_form_merges_and_drops():
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 0), (9, 9, 9)])
    mesh = canonical(points, np.array([(3, 1, 2), (0, 3, 1)]))
    assert len(mesh.vertices) == 3
    assert mesh.faces.tolist() == [[0, 2, 1]]
    assert mesh.faces.dtype == np.int32
