"""Tidying triangle lists: empty and doubled triangles, small holes, and creases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.meshes.geometry import turned
from tools.meshes.quadrics import Floats, Indices, border_edges, dot, face_normals, unit


def with_part(faces: Indices, part: int | Indices) -> NDArray[np.int64]:
    """Return triangles with the number of their part as fourth column, shape (m, 4)."""
    labels = np.broadcast_to(part, len(faces))
    return np.concatenate([faces, labels[:, None]], axis=1).astype(np.int64)


def moved(faces: Indices, target: Indices) -> NDArray[np.int64]:
    """Return triangles, shape (m, 4), with every vertex replaced by its target."""
    return with_part(target[faces[:, :3]], faces[:, 3])


def clean(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Drop empty triangles, repeated ones, and pairs of a part that lie back to back.

    Args:
        faces: Vertex indices and part, shape (m, 4).

    Returns:
        The rest, sorted, each triangle starting at its smallest vertex.
    """
    a, b, c, _ = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    (a, b, c), part = turned(faces[:, :3]).T, faces[:, 3]
    size = faces[:, :3].max(initial=0) + 1
    # A triangle as one number: it stays far below 2**63 for the meshes in question.
    key, first = np.unique((a * size + b) * size + c, return_index=True)
    a, b, c, part = a[first], b[first], c[first], part[first]
    back = (a * size + c) * size + b
    place = np.minimum(np.searchsorted(key, back), max(len(key) - 1, 0))
    alone = (key[place] != back) | (part[place] != part)
    return np.stack([a, b, c, part], axis=1)[alone]


def fill_holes(
    vertices: Floats, faces: NDArray[np.int64], perimeter: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Close the small holes of an open surface, and drop the small pieces that sat in some.

    Screw holes and cut-out letters cost many triangles, and stay as ragged gaps when there are
    few. The longest rim of a connected piece is its outline: it is never closed, but a piece with
    a short one, such as a letter or a button, is an inlay and goes.

    Args:
        vertices: Positions, shape (n, 3).
        faces: Vertex indices and part, shape (m, 4); each hole is closed by a fan around the
            middle of its rim.
        perimeter: Longest rim that counts as small, in the unit of the vertices.
    """
    start, end, face = border_edges(faces)
    piece_of = _pieces(faces, len(vertices))
    along = vertices[end] - vertices[start]
    lengths = np.sqrt(dot(along, along)).tolist()
    outline: dict[int, float] = {}
    rims = []
    for loop in _loops(start.tolist(), end.tolist()):
        piece, length = int(piece_of[start[loop[0]]]), sum(lengths[edge] for edge in loop)
        outline[piece] = max(outline.get(piece, 0.0), length)
        rims.append((piece, length, loop))
    inlays = [piece for piece, length in outline.items() if length <= perimeter]
    fans, middles = [faces[~np.isin(piece_of[faces[:, 0]], inlays)]], [vertices]
    for piece, length, loop in rims:
        if length > perimeter or piece in inlays or length == outline[piece]:
            continue
        apex = np.full(len(loop), len(vertices) + len(middles) - 1)
        fan = np.stack([end[loop], start[loop], apex], axis=1)
        fans.append(with_part(fan, faces[face[loop[0]], 3]))
        middles.append(vertices[start[loop]].sum(axis=0, keepdims=True) / len(loop))
    return np.concatenate(middles), np.concatenate(fans)


def split_creases(
    points: Floats, faces: Indices, cosine: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Give every smooth patch around a vertex a vertex of its own.

    A renderer that shades with one normal a vertex then draws edges sharp and curves smooth.

    Args:
        points: Positions, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        cosine: Triangles whose normals have a smaller cosine between them are parted.

    Returns:
        For every new vertex the old one it copies, shape (k,); and the faces of new vertices.
    """
    normals = unit(face_normals(points, faces))
    corner_of = {
        (f, v): 3 * f + k for f, row in enumerate(faces.tolist()) for k, v in enumerate(row)
    }
    patch = list(range(faces.size))
    sides: dict[tuple[int, int], list[int]] = {}
    for f, (a, b, c) in enumerate(faces.tolist()):
        for low, high in ((a, b), (b, c), (c, a)):
            sides.setdefault((min(low, high), max(low, high)), []).append(f)
    for ends, around in sides.items():
        for i, first in enumerate(around):
            for second in around[:i]:
                if dot(normals[first], normals[second]) >= cosine:
                    for v in ends:
                        _join(patch, corner_of[first, v], corner_of[second, v])
    roots = np.array([_root(patch, corner) for corner in range(faces.size)])
    old = faces.reshape(-1)
    order = np.lexsort((roots, old))
    first_of = np.concatenate([[True], roots[order][1:] != roots[order][:-1]])
    new = np.empty(faces.size, dtype=np.int64)
    new[order] = first_of.cumsum() - 1
    return old[order][first_of].astype(np.int64), new.reshape(-1, 3)


def _pieces(faces: Indices, size: int) -> NDArray[np.int64]:
    """Return for every vertex the smallest vertex that is connected to it, shape (size,)."""
    label = np.arange(size)
    while True:
        smallest = label[faces[:, :3]].min(axis=1)
        lower = label.copy()
        for corner in faces[:, :3].T:
            np.minimum.at(lower, corner, smallest)
        lower = lower[lower]
        if (lower == label).all():
            return label
        label = lower


def _loops(start: list[int], end: list[int]) -> list[list[int]]:
    """Follow directed edges and return the closed loops among them, as lists of edge numbers."""
    leaving: dict[int, list[int]] = {}
    for edge in reversed(range(len(start))):
        leaving.setdefault(start[edge], []).append(edge)
    loops = []
    for seed in range(len(start)):
        loop: list[int] = []
        at = start[seed]
        while leaving.get(at):
            edge = leaving[at].pop()
            loop.append(edge)
            at = end[edge]
            if at == start[seed]:
                loops.append(loop)
                break
    return loops


def _root(patch: list[int], corner: int) -> int:
    while patch[corner] != corner:
        patch[corner] = patch[patch[corner]]
        corner = patch[corner]
    return corner


def _join(patch: list[int], a: int, b: int) -> None:
    low, high = sorted((_root(patch, a), _root(patch, b)))
    patch[high] = low
