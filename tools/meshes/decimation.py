"""Light copies of detailed meshes that look the same from where cameras stand.

The steps: weld; close small holes and drop what filled them; merge the vertices of each cell of a
grid, which removes what is smaller than a cell; collapse the edges that matter least until the
budget is met; part vertices at creases. Everything is plain arithmetic in a fixed order, so that
the result is the same on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duobench.objects import Mesh
from tools.meshes.geometry import canonical, to_grid
from tools.meshes.hulls import convex_hull
from tools.meshes.quadrics import (
    Floats,
    Indices,
    cross,
    dot,
    minimise,
    scatter,
    surface_quadrics,
)
from tools.meshes.topology import clean, fill_holes, moved, split_creases, with_part

WELD = 1e-4
"""Vertices closer than about this many metres are one; also the unit of length in here."""
BORDER_WEIGHT = 2.0
"""How much more the outline of an open surface counts than the surface."""
CREASE_COSINE = 0.766
"""Edges sharper than 40 degrees are drawn sharp; a cylinder of ten sides is still drawn round."""

_POOL = 0.25
"""Share of the cheapest edges that one round may collapse."""
_POOL_LEAST = 64
"""Number of edges that a round looks at in any case."""
_LEAST_COSINE = 0.2
"""Largest turn of a triangle's normal in one collapse, as a cosine."""
_LEAST_HEIGHT = 0.03
"""Triangles flatter than this share of their longest side must not get flatter."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Edges:
    """Undirected edges; every field has one entry an edge."""

    a: NDArray[np.int64]
    """Vertex that stays."""
    b: NDArray[np.int64]
    """Vertex that is merged into the other."""
    shared: NDArray[np.int64]
    """Number of triangles at the edge."""
    place: Floats
    """Where the merged vertex goes, shape (k, 3)."""

    def take(self, index: Indices) -> _Edges:
        """Return some of the edges."""
        return _Edges(
            a=self.a[index], b=self.b[index], shared=self.shared[index], place=self.place[index]
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """A mesh to be reduced together with its neighbours."""

    mesh: Mesh
    """The detailed mesh."""
    fill: float
    """Rims up to this many metres are small holes, which are closed, or inlays, which go."""


def decimate(parts: Sequence[Part], *, triangles: int, cell: float) -> list[Mesh]:
    """Reduce image meshes to one triangle budget.

    Parts that touch, such as a white shell and the black band in its cut-out, are reduced
    together: they keep a common border, so no gap opens, and the budget goes where it shows.

    Args:
        parts: The detailed meshes.
        triangles: Triangle budget of all parts together.
        cell: Edge of a grid cell in metres; 0 merges nothing beforehand.

    Returns:
        One mesh for every part.
    """
    vertices, faces = _weld(parts)
    quadrics = surface_quadrics(vertices, faces, BORDER_WEIGHT)
    if cell:
        vertices, faces, quadrics = _cluster(vertices, faces, quadrics, cell / WELD)
    vertices, faces = _collapse(vertices, faces, quadrics, triangles)
    points = to_grid(vertices * WELD)
    return [_shaded(points, faces[faces[:, 3] == part, :3]) for part in range(len(parts))]


def outline(mesh: Mesh, vertices: int) -> Mesh:
    """Replace an image mesh by its convex hull with a limited number of corners."""
    hull = convex_hull(mesh.vertices, vertices)
    return _shaded(to_grid(hull.vertices), hull.faces)


def _weld(parts: Sequence[Part]) -> tuple[Floats, NDArray[np.int64]]:
    """Put all parts into one list of vertices, in units of `WELD`, and one of faces and parts."""
    corners, count = [], 0
    for number, part in enumerate(parts):
        points, index = np.unique(
            np.rint(part.mesh.vertices / WELD).astype(np.int64), axis=0, return_inverse=True
        )
        faces = clean(with_part(index.reshape(-1)[part.mesh.faces], number))
        vertices, faces = fill_holes(points.astype(np.float64), faces, part.fill / WELD)
        corners.append((vertices, faces + np.array([count, count, count, 0])))
        count += len(vertices)
    vertices, index = np.unique(
        np.concatenate([v for v, _ in corners]), axis=0, return_inverse=True
    )
    faces = np.concatenate([f for _, f in corners])
    return vertices, clean(with_part(index.reshape(-1)[faces[:, :3]], faces[:, 3]))


def _shaded(points: NDArray[np.int64], faces: Indices) -> Mesh:
    """Return a finished mesh: on the grid, in canonical order, with creases parted."""
    light = canonical(points, faces)
    old, faces = split_creases(light.vertices, light.faces, CREASE_COSINE)
    return Mesh(vertices=light.vertices[old], faces=faces.astype(np.int32))


def _cluster(
    vertices: Floats, faces: Indices, quadrics: Floats, cell: float
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Merge the vertices of each grid cell where their planes meet best."""
    cells, index = np.unique(
        np.floor(vertices / cell).astype(np.int64), axis=0, return_inverse=True
    )
    index = index.reshape(-1)
    count = np.bincount(index)[:, None]
    merged = scatter(index, quadrics, len(cells))
    place, _ = minimise(merged, scatter(index, vertices, len(cells)) / count)
    # Nearly parallel planes can meet far away; half a cell of overhang is enough for real edges.
    low = (cells - 0.5) * cell
    return np.clip(place, low, low + 2 * cell), clean(moved(faces, index)), merged


def _collapse(
    vertices: Floats, faces: NDArray[np.int64], quadrics: Floats, triangles: int
) -> tuple[Floats, NDArray[np.int64]]:
    """Collapse edges in rounds, many that do not touch each other at once, cheapest first."""
    pool = _POOL
    while len(faces) > triangles:
        edges, cost = _edges(vertices, faces, quadrics)
        order = np.lexsort((edges.b, edges.a, cost))
        edges = edges.take(order[: max(int(len(order) * pool), _POOL_LEAST)])
        edges = edges.take(_keeps_shape(vertices, faces, edges))
        if not len(edges.a):
            if pool == 1.0:
                break
            pool = min(1.0, 2 * pool)
            continue
        pool = _POOL
        edges = edges.take(_independent(faces, edges, len(vertices)))
        enough = np.searchsorted(edges.shared.cumsum(), len(faces) - triangles) + 1
        edges = edges.take(np.arange(min(enough, len(edges.a))))
        vertices[edges.a] = edges.place
        quadrics[edges.a] += quadrics[edges.b]
        target = np.arange(len(vertices))
        target[edges.b] = edges.a
        faces = clean(moved(faces, target))
    return vertices, faces


def _edges(vertices: Floats, faces: Indices, quadrics: Floats) -> tuple[_Edges, Floats]:
    """Return every edge with the place of its merged vertex, and what merging costs."""
    start, end = faces[:, :3].reshape(-1), faces[:, (1, 2, 0)].reshape(-1)
    size = len(vertices)
    key, shared = np.unique(
        np.minimum(start, end) * size + np.maximum(start, end), return_counts=True
    )
    a, b = key // size, key % size
    place, cost = minimise(quadrics[a] + quadrics[b], (vertices[a] + vertices[b]) / 2)
    return _Edges(a=a, b=b, shared=shared, place=place), cost


def _keeps_shape(vertices: Floats, faces: Indices, edges: _Edges) -> NDArray[np.int64]:
    """Return the numbers of the edges whose collapse turns no triangle over and flattens none."""
    corners = faces[:, :3].reshape(-1)
    by_vertex = np.argsort(corners, kind="stable")
    first = np.searchsorted(corners[by_vertex], np.arange(len(vertices) + 1))
    spoiled = np.zeros(len(edges.a), dtype=bool)
    for pulled, other in ((edges.a, edges.b), (edges.b, edges.a)):
        count = first[pulled + 1] - first[pulled]
        edge = np.repeat(np.arange(len(pulled)), count)
        within = np.arange(len(edge)) - np.repeat(count.cumsum() - count, count)
        corner = by_vertex[first[pulled][edge] + within]
        face, k = corner // 3, corner % 3
        left, right = faces[face, (k + 1) % 3], faces[face, (k + 2) % 3]
        stays = (left != other[edge]) & (right != other[edge])
        edge, left, right = edge[stays], vertices[left[stays]], vertices[right[stays]]
        bad = _spoils(vertices[pulled[edge]], edges.place[edge], left, right)
        spoiled[edge[bad]] = True
    return np.flatnonzero(~spoiled)


def _spoils(before: Floats, after: Floats, left: Floats, right: Floats) -> NDArray[np.bool_]:
    """Say for triangles (corner, left, right) whether moving the corner is a bad idea."""
    old, new = cross(left - before, right - before), cross(left - after, right - after)
    old_area, new_area = dot(old, old), dot(new, new)
    turned = dot(old, new) < _LEAST_COSINE * np.sqrt(old_area * new_area)
    old_side, new_side = _longest_side(before, left, right), _longest_side(after, left, right)
    flat = np.sqrt(new_area) < _LEAST_HEIGHT * new_side
    return turned | (flat & (new_area * old_side**2 < old_area * new_side**2))


def _longest_side(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the squared length of the longest side of triangles."""
    return np.maximum(np.maximum(dot(a - b, a - b), dot(b - c, b - c)), dot(c - a, c - a))


def _independent(faces: Indices, edges: _Edges, size: int) -> NDArray[np.int64]:
    """Pick edges such that no triangle touches two of them; earlier ones win."""
    number = np.arange(len(edges.a))
    at_vertex = np.full(size, len(number))
    for end in (edges.a, edges.b):
        np.minimum.at(at_vertex, end, number)
    at_face = at_vertex[faces[:, :3]].min(axis=1)
    nearby = np.full(size, len(number))
    for corner in faces[:, :3].T:
        np.minimum.at(nearby, corner, at_face)
    return np.flatnonzero((nearby[edges.a] == number) & (nearby[edges.b] == number))
