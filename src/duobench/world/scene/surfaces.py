"""Surfaces: collision groups, stiffness and friction, and boxes without contacts."""

from enum import IntFlag

import mujoco
import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.world.objects.shapes import Colour


class CollisionGroup(IntFlag):
    """Members of a group do not collide with each other, but for objects; one bit each.

    The joint ranges keep an arm's proximal links (up to the forearm) apart. Its distal part (wrist,
    gripper, camera) collides with everything but itself, so also with its own forearm.
    """

    LEFT_PROXIMAL = 1
    LEFT_DISTAL = 2
    RIGHT_PROXIMAL = 4
    RIGHT_DISTAL = 8
    OBJECT = 16
    FIXTURE = 32


_EVERYTHING = 63


PROXIMAL = {
    Side.LEFT: CollisionGroup.LEFT_PROXIMAL,
    Side.RIGHT: CollisionGroup.RIGHT_PROXIMAL,
}
"""Links 0 to 5 of an arm."""
DISTAL = {
    Side.LEFT: CollisionGroup.LEFT_DISTAL,
    Side.RIGHT: CollisionGroup.RIGHT_DISTAL,
}
"""Links 6 and 7, gripper and wrist camera of an arm."""


def collide_as(geom: mujoco.MjsGeom, group: CollisionGroup) -> None:
    """Make a geom collide as a member of a group: with all others, and objects with each other.

    MuJoCo lets two geoms collide when either one's type meets the other's affinity, so both sides
    carry the same relation.
    """
    geom.contype = int(group)
    geom.conaffinity = (
        _EVERYTHING if group is CollisionGroup.OBJECT else _EVERYTHING - int(group)
    )


def visual_only(geom: mujoco.MjsGeom, *, shadow: bool = True) -> None:
    """Make a geom an image without contacts and without mass, with or without a shadow."""
    geom.contype = 0
    geom.conaffinity = 0
    geom.density = 0.0
    geom.group = VISUAL_GEOM_GROUP if shadow else SHADOWLESS_GEOM_GROUP


SHADOWLESS_GEOM_GROUP = 1
"""Geom group that is rendered and casts no shadow: walls, and trim on a shell that casts one."""
VISUAL_GEOM_GROUP = 2
"""Geom group that is rendered; MuJoCo renders groups 0 to 2 by default."""
COLLISION_GEOM_GROUP = 3
"""Geom group that collides and is not rendered."""


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


def collide_as_metal(geom: mujoco.MjsGeom, group: CollisionGroup) -> None:
    """Make a geom of robot or mount collide as a member of a group, with the surface of metal.

    Of two geoms in contact MuJoCo takes the larger friction, unless one has priority: so that metal
    is as slippery on a rough object as on a smooth one, it has.
    """
    collide_as(geom, group)
    stiffen(geom)
    geom.friction = (METAL_FRICTION, TORSION, ROLLING)
    geom.priority = 1


def collide_unseen(geom: mujoco.MjsGeom, group: CollisionGroup) -> None:
    """Make a geom of the robot collide, without being rendered and without mass."""
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
    """Add a visible box without contacts; the pose of its middle, and full lengths in metres."""
    geom = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=np.array(size) / 2,
        pos=pose.translation,
        quat=pose.wxyz,
        rgba=rgba,
    )
    visual_only(geom, shadow=shadow)
    return geom
