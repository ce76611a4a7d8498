"""Triangle meshes as arrays: reading OBJ and STL bytes, welding, and one canonical order.

Coordinates are held as whole multiples of `RESOLUTION` wherever order or equality matters, so
that the bytes of a result do not depend on how a machine rounds.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from duobench.errors import AssetError
from duobench.objects import Mesh
from duobench.scene.robot.meshes import POINTS_PER_METRE

RESOLUTION = 1 / POINTS_PER_METRE
"""Grid in metres to which every published coordinate is rounded."""

_OBJ_VERTEX = re.compile(rb"^v +(\S+) +(\S+) +(\S+)", re.MULTILINE)
_OBJ_FACE = re.compile(rb"^f (.*)$", re.MULTILINE)
_STL_TRIANGLE = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")], align=False
)
_STL_HEADER = 80
_TRIANGLE = 3


def read(name: str, data: bytes) -> Mesh:
    """Parse the bytes of a mesh file.

    Args:
        name: File name; its suffix says the format, ".obj" or ".stl" (binary).
        data: Content of the file.

    Raises:
        AssetError: The format is not known, or the content does not follow it.
    """
    if name.endswith(".obj"):
        return _read_obj(name, data)
    if name.endswith(".stl"):
        return _read_stl(name, data)
    raise AssetError(f"{name} is no mesh file: expected a name that ends in .obj or .stl.")


def _read_obj(name: str, data: bytes) -> Mesh:
    corners = [line.split() for line in _OBJ_FACE.findall(data)]
    if any(len(corner) != _TRIANGLE for corner in corners):
        raise AssetError(f"{name} holds faces that are no triangles.")
    vertices = np.array(_OBJ_VERTEX.findall(data), dtype=np.float64).reshape(-1, 3)
    faces = np.array([[c.partition(b"/")[0] for c in row] for row in corners]).astype(np.int32) - 1
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        raise AssetError(f"{name} holds no triangles, or triangles of vertices that do not exist.")
    return Mesh(vertices=vertices, faces=faces)


def _read_stl(name: str, data: bytes) -> Mesh:
    count = int.from_bytes(data[_STL_HEADER : _STL_HEADER + 4], "little")
    if len(data) != _STL_HEADER + 4 + count * _STL_TRIANGLE.itemsize or not count:
        raise AssetError(f"{name} is no binary STL file: its length does not fit its count.")
    triangles = np.frombuffer(data, _STL_TRIANGLE, offset=_STL_HEADER + 4)
    vertices = triangles["corners"].reshape(-1, 3).astype(np.float64)
    return Mesh(vertices=vertices, faces=np.arange(3 * count, dtype=np.int32).reshape(-1, 3))


def to_grid(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """Express coordinates as whole multiples of `RESOLUTION`, shape unchanged."""
    return np.rint(vertices / RESOLUTION).astype(np.int64)


def from_grid(points: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return coordinates in metres; a division, so that the result is correctly rounded."""
    return points / POINTS_PER_METRE


def canonical(points: NDArray[np.int64], faces: NDArray[np.integer]) -> Mesh:
    """Return the mesh with equal points merged, empty triangles dropped and one fixed order.

    Args:
        points: Positions on the grid, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
    """
    merged, index = np.unique(points, axis=0, return_inverse=True)
    a, b, c = index.reshape(-1)[faces].T
    faces = np.stack([a, b, c], axis=1)[(a != b) & (b != c) & (c != a)]
    used, faces = np.unique(faces, return_inverse=True)
    ordered = np.unique(turned(faces.reshape(-1, 3)), axis=0)
    return Mesh(vertices=from_grid(merged[used]), faces=ordered.astype(np.int32))


def turned(faces: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return triangles that start at their smallest vertex, in the same sense."""
    start = faces.argmin(axis=1)
    return np.stack([faces[np.arange(len(faces)), (start + k) % 3] for k in range(3)], axis=1)
