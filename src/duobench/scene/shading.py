"""Normals of drawn meshes: curves are drawn round and edges sharp."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CREASE = math.radians(40.0)
"""Edges sharper than this are drawn sharp; a prism of ten sides is still drawn round."""

FLAT = math.radians(1.0)
"""Crease angle with which every face of a machined part is drawn flat."""


def corner_normals(vertices: Array, faces: NDArray[np.integer], crease: float = CREASE) -> Array:
    """One unit normal for every corner of every triangle.

    A corner's normal is the mean, by area, of the triangles around its vertex that are turned by
    at most the crease angle against its own triangle.

    Args:
        vertices: Positions (n, 3).
        faces: Vertices of each triangle (m, 3), counter-clockwise from outside.
        crease: Largest angle in radians that is drawn round.

    Returns:
        Normals (3 m, 3), triangle by triangle.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    unit = weighted / np.maximum(np.linalg.norm(weighted, axis=1, keepdims=True), 1e-300)
    corners = faces.ravel()
    by_vertex = np.argsort(corners, kind="stable")
    counts = np.bincount(corners, minlength=len(vertices))
    starts = np.concatenate([[0], counts.cumsum()])
    # Every pair of a corner and a triangle that has the corner's vertex.
    own = np.repeat(np.arange(len(corners)), counts[corners])
    rank = np.arange(len(own)) - np.repeat(
        np.concatenate([[0], counts[corners].cumsum()[:-1]]), counts[corners]
    )
    other = by_vertex[starts[corners[own]] + rank] // 3
    near = np.einsum("ij,ij->i", unit[own // 3], unit[other]) >= math.cos(crease)
    normals = np.zeros((len(corners), 3))
    np.add.at(normals, own[near], weighted[other[near]])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def add_drawn_mesh(
    spec: mujoco.MjSpec,
    name: str,
    vertices: Array,
    faces: NDArray[np.integer],
    crease: float = CREASE,
) -> str:
    """Add a mesh with normals to a model under construction, and return its name.

    Args:
        spec: The model.
        name: Name of the mesh.
        vertices: Positions (n, 3) in metres.
        faces: Vertices of each triangle (m, 3), counter-clockwise from outside.
        crease: Largest angle in radians between triangles that is drawn round.
    """
    spec.add_mesh(
        name=name,
        uservert=vertices.ravel(),
        userface=faces.ravel(),
        usernormal=corner_normals(vertices, faces, crease).ravel(),
        userfacenormal=np.arange(faces.size, dtype=np.int32),
    )
    return name
