"""Error quadrics: how far a point is from a set of planes, as ten numbers that can be added.

A plane n·x + d = 0 with weight w contributes w·(n·x + d)², a quadratic form in x. The measure and
its use for merging vertices are those of Garland and Heckbert, "Surface Simplification Using
Quadric Error Metrics" (SIGGRAPH 1997). All arithmetic is element by element, without linear
algebra libraries, so that every machine computes the same bits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.integer]

COEFFICIENTS = 10
"""Numbers that make up a quadric: xx, xy, xz, x, yy, yz, y, zz, z, 1."""


def dot(a: Floats, b: Floats) -> Floats:
    """Return the scalar products of vectors, shapes (..., 3) to (...)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def cross(a: Floats, b: Floats) -> Floats:
    """Return the vector products of vectors, shapes (..., 3) to (..., 3)."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def unit(a: Floats) -> Floats:
    """Return vectors scaled to length one; zero vectors stay zero."""
    length = np.sqrt(dot(a, a))
    return a / np.where(length > 0, length, 1.0)[..., None]


def face_normals(vertices: Floats, faces: Indices) -> Floats:
    """Return normals of twice the triangle's area, pointing out, shape (m, 3)."""
    corner = vertices[faces[:, 0]]
    return cross(vertices[faces[:, 1]] - corner, vertices[faces[:, 2]] - corner)


def surface_quadrics(vertices: Floats, faces: Indices, border_weight: float) -> Floats:
    """Return the quadric of every vertex.

    Each triangle counts with its area at its corners. Each border edge adds a plane through the
    edge, upright on its triangle, so that the outline of every part keeps its place.

    Args:
        vertices: Positions, shape (n, 3).
        faces: Vertex indices and part, shape (m, 4).
        border_weight: Weight of border planes, against 1 for the surface.

    Returns:
        Quadrics, shape (n, 10).
    """
    quadrics = np.zeros((len(vertices), COEFFICIENTS))
    normals = face_normals(vertices, faces)
    area = np.sqrt(dot(normals, normals)) / 2
    normals = unit(normals)
    planes = _plane_quadrics(normals, vertices[faces[:, 0]], area / 3)
    for corner in faces[:, :3].T:
        quadrics += scatter(corner, planes, len(vertices))
    start, end, face = border_edges(faces)
    along = vertices[end] - vertices[start]
    upright = unit(cross(along, normals[face]))
    planes = _plane_quadrics(upright, vertices[start], border_weight * dot(along, along))
    for corner in (start, end):
        quadrics += scatter(corner, planes, len(vertices))
    return quadrics


def border_edges(faces: Indices) -> tuple[Indices, Indices, Indices]:
    """Return start, end and triangle of every edge that one triangle alone has in its part.

    Args:
        faces: Vertex indices and part, shape (m, 4).
    """
    start, end = faces[:, :3].reshape(-1), faces[:, (1, 2, 0)].reshape(-1)
    low, high, part = np.minimum(start, end), np.maximum(start, end), np.repeat(faces[:, 3], 3)
    size, parts = faces[:, :3].max(initial=0) + 1, part.max(initial=0) + 1
    key = (low * size + high) * parts + part
    _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
    single = np.flatnonzero(count[inverse] == 1)
    return start[single], end[single], single // 3


def minimise(quadrics: Floats, near: Floats) -> tuple[Floats, Floats]:
    """Return the point of least error for every quadric, and that error.

    Args:
        quadrics: Quadrics, shape (k, 10).
        near: Where the point should rather be when the planes leave it free, shape (k, 3).
    """
    xx, xy, xz, x, yy, yz, y, zz, z, _ = quadrics.T
    pull = (xx + yy + zz) * 1e-3 + 1e-12
    a, b, c, d, e, f = xx + pull, xy, xz, yy + pull, yz, zz + pull
    right = np.stack([-x, -y, -z], axis=1) + pull[:, None] * near
    # Cramer's rule with the cofactors of a symmetric matrix.
    first = np.stack([d * f - e * e, c * e - b * f, b * e - c * d], axis=1)
    second = np.stack([first[:, 1], a * f - c * c, b * c - a * e], axis=1)
    third = np.stack([first[:, 2], second[:, 2], a * d - b * b], axis=1)
    determinant = a * first[:, 0] + b * first[:, 1] + c * first[:, 2]
    solved = np.stack([dot(row, right) for row in (first, second, third)], axis=1)
    point = solved / determinant[:, None]
    off = point - near
    return point, np.maximum(_evaluate(quadrics, point) + pull * dot(off, off), 0.0)


def scatter(index: Indices, values: Floats, size: int) -> Floats:
    """Add up rows by index, shape (k, c) to (size, c), in the order in which they come."""
    total = np.empty((size, values.shape[1]))
    for column, summands in enumerate(values.T):
        total[:, column] = np.bincount(index, summands, minlength=size)
    return total


def _plane_quadrics(normals: Floats, points: Floats, weights: Floats) -> Floats:
    a, b, c = normals.T
    d = -dot(normals, points)
    terms = (a * a, a * b, a * c, a * d, b * b, b * c, b * d, c * c, c * d, d * d)
    return np.stack(terms, axis=1) * weights[:, None]


def _evaluate(quadrics: Floats, points: Floats) -> Floats:
    xx, xy, xz, x, yy, yz, y, zz, z, one = quadrics.T
    u, v, w = points.T
    square = xx * u * u + yy * v * v + zz * w * w
    mixed = xy * u * v + xz * u * w + yz * v * w + x * u + y * v + z * w
    return square + 2 * mixed + one
