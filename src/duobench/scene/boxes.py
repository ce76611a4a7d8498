"""Boxes of the workcell, which are seen and never weigh anything."""

from __future__ import annotations

import mujoco
import numpy as np

from duobench.objects.shapes import Colour
from duobench.scene.filters import visual_only
from duobench.spatial import SE3


def add_box(
    body: mujoco.MjsBody,
    pose: SE3,
    size: tuple[float, float, float],
    rgba: Colour,
    *,
    shadow: bool = True,
) -> mujoco.MjsGeom:
    """Add a box that is seen; what else it does is up to the caller.

    Args:
        body: What carries it.
        pose: Its middle, in the frame of that body.
        size: Full lengths of its edges in metres.
        rgba: Its colour.
        shadow: Whether it casts one.
    """
    geom = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=np.array(size) / 2,
        pos=pose.translation,
        quat=pose.wxyz,
        rgba=rgba,
    )
    visual_only(geom, shadow=shadow)
    return geom
