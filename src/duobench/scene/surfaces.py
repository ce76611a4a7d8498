"""Surfaces: how hard and how rough they are, in one place, and boxes that are only seen."""

from __future__ import annotations

import mujoco
import numpy as np

from duobench.objects.shapes import Colour
from duobench.scene.filters import COLLISION_GEOM_GROUP, Group, collide_as, visual_only
from duobench.spatial import SE3

CONTACT_SOLREF = (0.005, 1.0)
"""Contact time constant just above two time steps, the stiffest that MuJoCo keeps stable, and
damping ratio."""
CONTACT_SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)

METAL_FRICTION = 0.3
"""Sliding friction of links, linkages, cameras and mount: painted or bare metal on plastic. Only
the pads are rubber."""
TORSION, ROLLING = 0.005, 0.0001
"""Torsional and rolling friction in metres, MuJoCo's defaults."""


def stiffen(geom: mujoco.MjsGeom) -> None:
    """Make a geom as hard as MuJoCo keeps stable."""
    geom.solref, geom.solimp = CONTACT_SOLREF, CONTACT_SOLIMP


def collide_as_metal(geom: mujoco.MjsGeom, group: Group) -> None:
    """Make a geom of robot or mount collide as a member of a group, with the surface of metal.

    Of two geoms in contact MuJoCo takes the larger friction, unless one has priority: so that metal
    is as slippery on a rough object as on a smooth one, it has.
    """
    collide_as(geom, group)
    stiffen(geom)
    geom.friction = (METAL_FRICTION, TORSION, ROLLING)
    geom.priority = 1


def collide_unseen(geom: mujoco.MjsGeom, group: Group) -> None:
    """Make a geom of the robot collide in the place of what is seen, without a mass of its own."""
    collide_as_metal(geom, group)
    geom.density, geom.group = 0.0, COLLISION_GEOM_GROUP


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
