"""Normals of visual meshes: curves look round and edges sharp."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.objects.solid import Mesh
from duobench.types import Array

CREASE = math.radians(8.0)
"""Edges sharper than this look sharp; circles have 64 segments, so they look round."""
FLAT = math.radians(1.0)
"""Crease angle with which every face of a machined part looks flat."""

_TINY = 1e-300
_SAME = 1e-4
"""Normals that differ by less than this, in each component, are one."""


def corner_normals(vertices: Array, faces: NDArray[np.integer], crease: float = CREASE) -> Array:
    """One unit normal for every corner of every triangle.

    A corner's normal is the mean over the triangles around its vertex that are turned by at most
    the crease angle against its own triangle. Each counts by its angle at the vertex, so that the
    result depends on the surface and not on how it was cut into triangles.

    Args:
        vertices: Positions (n, 3).
        faces: Vertices of each triangle (m, 3), counter-clockwise from outside.
        crease: Largest angle in radians that looks round.

    Returns:
        Normals (3 m, 3), triangle by triangle.
    """
    a = vertices[faces]
    onward = _unit(np.roll(a, -1, axis=1) - a)
    back = _unit(np.roll(a, 1, axis=1) - a)
    cosines = np.clip(np.einsum("fcx,fcx->fc", onward, back), -1.0, 1.0)
    # NumPy's own arc cosine differs in the last bit from one type of processor to the next.
    angles = np.array([math.acos(cosine) for cosine in cosines.ravel().tolist()])
    normals = _unit(np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0]))
    # Every pair of a corner and a corner of another triangle, or the same, at its vertex.
    corners = faces.ravel()
    by_vertex = np.argsort(corners, kind="stable")
    counts = np.bincount(corners, minlength=len(vertices))
    start = counts.cumsum() - counts
    pairs = counts[corners]
    one = np.repeat(np.arange(len(corners)), pairs)
    rank = np.arange(len(one)) - np.repeat(pairs.cumsum() - pairs, pairs)
    other = by_vertex[start[corners[one]] + rank]
    near = np.einsum("px,px->p", normals[one // 3], normals[other // 3]) >= math.cos(crease)
    one, other = one[near], other[near]
    total = np.zeros((len(corners), 3))
    np.add.at(total, one, normals[other // 3] * angles[other, None])
    return _unit(total)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), _TINY)


def add_visual_mesh(spec: mujoco.MjSpec, name: str, mesh: Mesh, crease: float = CREASE) -> str:
    """Add a mesh with normals to a model under construction, and return its name.

    MuJoCo takes one normal a vertex, so a vertex on a sharp edge is there once for each side.

    Args:
        spec: The model.
        name: Its name.
        mesh: The mesh.
        crease: Largest angle in radians between triangles that looks round.
    """
    vertices, faces = mesh.vertices, mesh.faces
    normals = corner_normals(vertices, faces, crease)
    keys = np.column_stack([faces.ravel(), np.rint(normals / _SAME)])
    _, first, corners = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    spec.add_mesh(
        name=name,
        uservert=vertices[faces.ravel()[first]].ravel(),
        usernormal=normals[first].ravel(),
        userface=corners.ravel().astype(np.int32),
        # It carries no mass, so it may be open.
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    return name
