"""Shadows of thin walls: no light comes through the seam between a wall and the floor beside it.

MuJoCo moves every face of the shadow map away from the light by one and a half texels times the
face's slope, so that no surface lies in its own shadow. A wall that runs along the light is so
steep that it moves by centimetres, to beyond the floor: its seam is lit, in bright dashes. A level
face moves by 2 mm only. Inside the wall nobody sees it, and light for the seam has to pass it.
"""

from __future__ import annotations

import manifold3d
import numpy as np

from duobench.objects.shapes import at_height
from duobench.objects.solid import Mesh, manifold_from

RIB_HEIGHT = 0.0015
"""Height in metres above a floor of the level face in the walls around it. Measured on bowls and
cups at all yaws: it leaves a seventh of the leaks, and 1 mm or 2.5 mm would leave a fourth."""

_LEVEL = 0.999
"""A normal with a larger upward component belongs to a floor."""
_SAME = 6
"""Digits after the point, in metres, to which the height of a floor counts."""


def add_ribs(mesh: Mesh) -> Mesh:
    """The mesh of a solid with a level face inside its walls just above each of its floors."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = across[:, 2] > _LEVEL * np.linalg.norm(across, axis=1)
    # Nothing stands on the highest one.
    floors = np.unique(corners[level, 0, 2].round(_SAME))[:-1]
    solid = manifold_from(mesh)
    vertices, faces, count = [mesh.vertices], [mesh.faces], len(mesh.vertices)
    for height in (floors + RIB_HEIGHT).tolist():
        section = solid.slice(height).to_polygons()
        if not section:
            continue
        points = np.vstack(section)
        vertices.append(at_height(points, height))
        faces.append(np.asarray(manifold3d.triangulate(section), dtype=np.int32) + count)
        count += len(points)
    return Mesh(vertices=np.vstack(vertices), faces=np.vstack(faces))
