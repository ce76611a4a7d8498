"""Meshes with known geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.meshes.geometry import Mesh


def grid(rows: int, columns: int, step: float) -> Mesh:
    """A flat plate in the plane z = 0 that faces up, with one corner at the origin."""
    x, y = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * step
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    right, up = corner + 1, corner + columns + 1
    faces = np.concatenate(
        [np.stack([corner, right, up + 1], axis=1), np.stack([corner, up + 1, up], axis=1)]
    )
    return Mesh(vertices=vertices, faces=faces.astype(np.int32))


def sphere(radius: float, rings: int = 40, sectors: int = 64) -> Mesh:
    """A closed sphere around the origin."""
    polar = np.pi * np.arange(1, rings) / rings
    around = 2 * np.pi * np.arange(sectors) / sectors
    belt = np.stack(
        [
            np.outer(np.sin(polar), np.cos(around)).ravel(),
            np.outer(np.sin(polar), np.sin(around)).ravel(),
            np.outer(np.cos(polar), np.ones(sectors)).ravel(),
        ],
        axis=1,
    )
    vertices = radius * np.concatenate([belt, [[0, 0, 1], [0, 0, -1]]])
    index = np.arange(len(belt)).reshape(-1, sectors)
    after = np.roll(index, -1, axis=1)
    top, bottom = np.full(sectors, len(belt)), np.full(sectors, len(belt) + 1)
    faces = [
        np.stack([index[:-1], index[1:], after[1:]], axis=-1).reshape(-1, 3),
        np.stack([index[:-1], after[1:], after[:-1]], axis=-1).reshape(-1, 3),
        np.stack([top, index[0], after[0]], axis=1),
        np.stack([bottom, after[-1], index[-1]], axis=1),
    ]
    return Mesh(vertices=vertices, faces=np.concatenate(faces).astype(np.int32))


def box(size: tuple[float, float, float]) -> Mesh:
    """A closed box around the origin."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return Mesh(vertices=corners * size, faces=np.array(faces, dtype=np.int32))


def shuffled(mesh: Mesh, seed: int) -> Mesh:
    """The same surface with vertices, triangles and starting corners in another order."""
    random = np.random.default_rng(seed)
    order = random.permutation(len(mesh.vertices))
    place = np.empty(len(order), dtype=np.int32)
    place[order] = np.arange(len(order))
    faces = place[mesh.faces][random.permutation(len(mesh.faces))]
    turns = random.integers(0, 3, size=len(faces))
    corners = (np.arange(3) + turns[:, None]) % 3
    return Mesh(vertices=mesh.vertices[order], faces=np.take_along_axis(faces, corners, axis=1))


def volume(mesh: Mesh) -> float:
    """Signed volume; positive when the triangles of a closed mesh face outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def area(mesh: Mesh) -> float:
    """Total area of the triangles."""
    return float(np.linalg.norm(normals(mesh), axis=1).sum() / 2)


def normals(mesh: Mesh) -> NDArray[np.float64]:
    """Normals of twice the triangles' areas."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def open_edges(mesh: Mesh) -> int:
    """Number of edges that have no partner running the other way, by position."""
    _, index = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    edges = {(int(f[k]), int(f[(k + 1) % 3])) for f in faces for k in range(3)}
    return sum((b, a) not in edges for a, b in edges)
