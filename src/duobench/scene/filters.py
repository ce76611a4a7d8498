"""Who collides with whom: one bit a group, in MuJoCo's contype and conaffinity.

An arm's proximal links (up to the forearm) do not collide with each other: the joint ranges already
keep them apart. Its distal part (wrist, gripper, camera) collides with everything but itself, so
that a gripper cannot pass through its own forearm. Fixtures never collide with fixtures.
"""

from __future__ import annotations

from enum import IntFlag

import mujoco

from duobench.types import Side


class Group(IntFlag):
    """Collision groups."""

    LEFT_PROXIMAL = 1
    LEFT_DISTAL = 2
    RIGHT_PROXIMAL = 4
    RIGHT_DISTAL = 8
    OBJECT = 16
    FIXTURE = 32


_EVERYTHING = 63


def proximal(side: Side) -> Group:
    """Links 0 to 5 of an arm."""
    return Group.LEFT_PROXIMAL if side is Side.LEFT else Group.RIGHT_PROXIMAL


def distal(side: Side) -> Group:
    """Links 6 and 7, gripper and wrist camera of an arm."""
    return Group.LEFT_DISTAL if side is Side.LEFT else Group.RIGHT_DISTAL


def collide_as(geom: mujoco.MjsGeom, group: Group) -> None:
    """Make a geom collide as a member of a group: with all others, and objects with each other.

    MuJoCo lets two geoms collide when either one's type meets the other's affinity, so both sides
    carry the same relation.
    """
    geom.contype = int(group)
    geom.conaffinity = _EVERYTHING if group is Group.OBJECT else _EVERYTHING - int(group)


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
