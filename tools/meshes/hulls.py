"""Convex hulls with few vertices, in exact integer arithmetic.

Points sit on the grid of `geometry.RESOLUTION`; an object of half a metre spans 5e4 steps, and
the determinants below stay under 2**53, so every sign is exact and the hull is the same on every
machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from duobench.errors import AssetError
from duobench.objects import Mesh
from tools.meshes.geometry import canonical, to_grid

_OUTSIDE = 1.0
"""Distance in grid steps from which on a point counts as outside of a hull."""
_TETRAHEDRON = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))


def convex_hull(vertices: NDArray[np.float64], max_vertices: int) -> Mesh:
    """Return the hull of a few of the points: those that bound the shape best.

    The hull grows from a tetrahedron by the point farthest outside of it, until no point is
    outside or the number of vertices is reached. It never reaches beyond the true hull.

    Args:
        vertices: Positions in metres, shape (n, 3).
        max_vertices: Largest number of vertices of the result, at least 4.

    Raises:
        AssetError: The points lie in one plane.
    """
    points = np.unique(to_grid(vertices), axis=0)
    first = _tetrahedron(points)
    faces = [tuple(first[corner] for corner in face) for face in _TETRAHEDRON]
    heights = [_heights(points, face) for face in faces]
    for _ in range(max_vertices - len(first)):
        above = np.array([_scaled(points, f, h) for f, h in zip(faces, heights, strict=True)])
        if above.max() < _OUTSIDE:
            break
        apex = int(above.max(axis=0).argmax())
        # Faces in whose plane the apex lies are replaced too, so no empty triangle can arise.
        below = [int(h[apex]) < 0 for h in heights]
        kept = [face for face, keep in zip(faces, below, strict=True) if keep]
        edges = {edge for face in kept for edge in _edges(face)}
        horizon = sorted((b, a) for a, b in edges if (b, a) not in edges)
        new = [(a, b, apex) for a, b in horizon]
        heights = [h for h, keep in zip(heights, below, strict=True) if keep]
        heights += [_heights(points, face) for face in new]
        faces = kept + new
    return canonical(points, np.array(faces))


def _tetrahedron(points: NDArray[np.int64]) -> tuple[int, int, int, int]:
    """Pick four points that span a large volume, ordered so that `_TETRAHEDRON` faces outward."""
    a = 0
    b = int(((points - points[a]) ** 2).sum(axis=1).argmax())
    normals = np.cross(points - points[a], points[b] - points[a])
    c = int((normals.astype(np.float64) ** 2).sum(axis=1).argmax())
    volumes = _heights(points, (a, b, c))
    d = int(np.abs(volumes).argmax())
    if not volumes[d]:
        raise AssetError("A convex hull needs points that do not all lie in one plane.")
    return (a, b, c, d) if volumes[d] < 0 else (a, c, b, d)


def _heights(points: NDArray[np.int64], face: tuple[int, ...]) -> NDArray[np.int64]:
    """Return six times the signed volume between the face and each point, positive outside."""
    origin = points[face[0]]
    normal = np.cross(points[face[1]] - origin, points[face[2]] - origin)
    return (points - origin) @ normal


def _scaled(
    points: NDArray[np.int64], face: tuple[int, ...], heights: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Turn volumes into distances from the face's plane, in grid steps."""
    origin = points[face[0]]
    normal = np.cross(points[face[1]] - origin, points[face[2]] - origin)
    return heights / np.sqrt(float((normal.astype(np.float64) ** 2).sum()))


def _edges(face: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    a, b, c = face
    return ((a, b), (b, c), (c, a))
