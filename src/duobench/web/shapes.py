"""Triangles of the simple shapes of a model; its meshes bring their own."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.errors import DuoBenchError
from duobench.types import Array

SLICES, STACKS = 16, 8
"""Fineness of what is round, about its axis and along it."""

_KIND = mujoco.mjtGeom


@dataclass(frozen=True, kw_only=True, slots=True)
class Triangles:
    """A surface, in the frame of its geom."""

    points: Array
    """Corners (n, 3) in metres."""
    normals: Array
    """Their unit normals (n, 3), outward."""
    corners: NDArray[np.int64]
    """Numbers of the corners of each triangle (m, 3), counter-clockwise from outside."""


def triangles_of(model: mujoco.MjModel, geom: int, cells: tuple[int, int] = (1, 1)) -> Triangles:
    """The surface of a geom.

    Args:
        model: The model.
        geom: Its id.
        cells: Into how many cells a plane is cut along x and y, so that its colour can change from
            corner to corner.

    Raises:
        DuoBenchError: It is a height field or a signed distance field, which have no such surface.
    """
    kind = int(model.geom_type[geom])
    if kind == _KIND.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    x, y, z = model.geom_size[geom].tolist()
    makers = {
        _KIND.mjGEOM_PLANE.value: lambda: _plane(x, y, cells),
        _KIND.mjGEOM_BOX.value: lambda: _box(x, y, z),
        _KIND.mjGEOM_SPHERE.value: lambda: _ellipsoid(x, x, x),
        _KIND.mjGEOM_ELLIPSOID.value: lambda: _ellipsoid(x, y, z),
        _KIND.mjGEOM_CYLINDER.value: lambda: cylinder(x, y),
        _KIND.mjGEOM_CAPSULE.value: lambda: _capsule(x, y),
    }
    if kind not in makers:
        name = _KIND(kind).name.removeprefix("mjGEOM_").lower()
        raise DuoBenchError(
            f"The geom {model.geom(geom).name!r} is a {name}, which a browser is not shown; what "
            "works is plane, box, sphere, ellipsoid, cylinder, capsule and mesh."
        )
    return makers[kind]()


def box(size: tuple[float, float, float]) -> Triangles:
    """A box by its full size in metres."""
    x, y, z = size
    return _box(x / 2, y / 2, z / 2)


def cylinder(radius: float, half_height: float) -> Triangles:
    """An upright cylinder, in metres."""
    return _revolved(
        [(0, -1), (1, -1), (1, -1), (1, 1), (1, 1), (0, 1)],
        [(0, -1), (0, -1), (1, 0), (1, 0), (0, 1), (0, 1)],
        (radius, half_height),
    )


def _mesh(model: mujoco.MjModel, mesh: int) -> Triangles:
    """A mesh of the model; corners that share place and normal are one."""
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    pairs = np.stack([model.mesh_face[faces], model.mesh_facenormal[faces]], axis=-1)
    unique, corners = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    return Triangles(
        points=model.mesh_vert[model.mesh_vertadr[mesh] + unique[:, 0]].astype(np.float64),
        normals=model.mesh_normal[model.mesh_normaladr[mesh] + unique[:, 1]].astype(np.float64),
        corners=corners.reshape(-1, 3).astype(np.int64),
    )


def _plane(half_x: float, half_y: float, cells: tuple[int, int]) -> Triangles:
    """A plane that faces along z; one without end reaches 10 m."""
    along_x, along_y = (np.linspace(-1.0, 1.0, count + 1) for count in cells)
    x, y = np.meshgrid(along_x * (half_x or 10.0), along_y * (half_y or 10.0), indexing="ij")
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    normals = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
    return Triangles(points=points, normals=normals, corners=_grid(*x.shape))


def _box(x: float, y: float, z: float) -> Triangles:
    points, normals, corners = [], [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = sign * np.eye(3)[axis]
            u = np.eye(3)[(axis + 1) % 3]
            v = np.cross(normal, u)
            corners += [[len(points) + i for i in face] for face in ((0, 1, 2), (0, 2, 3))]
            points += [normal - u - v, normal + u - v, normal + u + v, normal - u + v]
            normals += [normal] * 4
    return Triangles(
        points=np.array(points) * (x, y, z), normals=np.array(normals), corners=np.array(corners)
    )


def _ellipsoid(x: float, y: float, z: float) -> Triangles:
    angles = np.linspace(-np.pi / 2, np.pi / 2, STACKS + 1)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    ball = _revolved(circle, circle, (1.0, 1.0))
    normals = ball.points / (x, y, z)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Triangles(points=ball.points * (x, y, z), normals=normals, corners=ball.corners)


def _capsule(radius: float, half_height: float) -> Triangles:
    quarter = np.linspace(0.0, np.pi / 2, STACKS // 2 + 1)
    angles = np.concatenate([quarter - np.pi / 2, quarter])
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    ends = np.repeat([-half_height, half_height], len(quarter))
    profile = radius * circle + np.stack([np.zeros_like(ends), ends], axis=-1)
    return _revolved(profile, circle, (1.0, 1.0))


def _revolved(profile: object, normals: object, scale: tuple[float, float]) -> Triangles:
    """The surface that a line (n, 2) in the plane of radius and z sweeps about z, from below up."""
    line, across = (np.asarray(each, dtype=np.float64) for each in (profile, normals))
    angles = np.linspace(0.0, 2 * np.pi, SLICES + 1)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)

    def swept(points: Array) -> Array:
        turned = points[None, :, :1] * around[:, None, :]
        up = np.broadcast_to(points[None, :, 1:], (*turned.shape[:2], 1))
        return np.concatenate([turned, up], axis=-1).reshape(-1, 3)

    return Triangles(
        points=swept(line * scale), normals=swept(across), corners=_grid(len(angles), len(line))
    )


def _grid(rows: int, columns: int) -> NDArray[np.int64]:
    """Triangles (m, 3) between the neighbours of a grid of points, numbered row by row."""
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    return np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
