"""Light copies of detailed meshes: cluster, simplify, split at creases, order."""

from __future__ import annotations

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from duobench.assets.geometry import Mesh, canonical, drop_degenerate, to_grid


def decimate(mesh: Mesh, *, cell: float, triangles: int) -> Mesh:
    """Reduce a picture mesh to a triangle budget.

    Vertices are clustered on a grid first, because a mesh of many small disconnected parts stops
    edge collapse long before the budget.

    Args:
        mesh: The detailed mesh.
        cell: Edge of a grid cell in metres.
        triangles: Triangle budget; small meshes are returned whole.
    """
    vertices, faces = _cluster(mesh.vertices, mesh.faces, cell)
    if len(faces) > triangles:
        vertices, faces = fast_simplification.simplify(
            vertices, faces.astype(np.int32), target_count=triangles
        )
    return canonical(to_grid(vertices), faces)


def _cluster(
    vertices: NDArray[np.float64], faces: NDArray[np.integer], cell: float
) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Move every vertex to the mean of its grid cell and drop what becomes empty."""
    _, index = np.unique(np.floor(vertices / cell).astype(np.int64), axis=0, return_inverse=True)
    index = index.reshape(-1)
    count = np.bincount(index)
    means = np.stack([np.bincount(index, vertices[:, k]) / count for k in range(3)], axis=1)
    faces = drop_degenerate(index[faces])
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    faces = faces[np.sort(first)]
    used, faces = np.unique(faces, return_inverse=True)
    return means[used], faces.reshape(-1, 3)
