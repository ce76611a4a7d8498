"""A cooking pot with a swing handle on either side, and the stove plate it is put on.

A handle folds out about a hinge near the pot's bottom, like that of a casserole carrier. This is
what makes the pot a task for two arms: a pot that is lifted by one handle turns about its hinge,
far side down, however the gripper holds the handle. What a gripper can push on from outside, the
wall above the hinge, turns it further; below the hinge there is no room for a finger. With both
hinges held the pot cannot turn. Handles that are fixed to the wall would not do: in simulation one
gripper carries even a pot of 4 kg level, by a corner of such a handle.
"""

from __future__ import annotations

import math

from duobench.solids.prop import Hinge, Part, Prop
from duobench.solids.shapes import CIRCLE_SEGMENTS, Shape, box, circle, cylinder, prism
from duobench.solids.solid import Solid, mass_properties
from duobench.spatial import SE3

RADIUS = 0.110
HEIGHT = 0.110
"""Outer radius and height in metres [task definitions]."""
LID_HEIGHT = 0.018
LID_TAPER = 0.62
"""Height of the lid in metres, and its upper radius as a part of the lower one. The lid stays on: a
gripper could carry an open pot alone, by its wall."""
MASS = 1.2
"""Mass of the whole pot in kg [task definitions]."""
ALUMINIUM_DENSITY = 2700.0
"""Density of the handles in kg/m³."""

HANDLE_OFFSET = 0.150
HANDLE_Z = 0.035
"""Distance in metres of a handle's bar from the pot's axis (a finger fits between bar and wall),
and its height above the pot's centre, with the handle at rest."""
BAR_RADIUS = 0.005
"""Radius of a handle's bar in metres."""
BAR_LENGTH = 0.080
"""Length in metres of a bar, between its two arms."""
ARM = 0.010
"""Edge in metres of the square arms that carry a bar."""

HINGE_OFFSET = 0.118
HINGE_Z = -0.043
"""Distance in metres of a handle's hinge from the pot's axis, and its height above the centre: with
hinges above the centre, fingertips could hold the pot level by its wall below them."""
OUTWARDS = 2.7
INWARDS = 0.35
"""How far a handle turns from rest, in radians: out and down until it hangs straight below its
hinge, and in to the wall. A stop on its way out would let one gripper carry the pot by it."""
STIFFNESS = 0.15
DAMPING = 0.01
"""Spring in N·m/rad and damping in N·m·s/rad that keep an untouched handle off wall and table. The
pot's weight on one hinge turns it with 1.4 N·m."""
KNUCKLE = (0.008, 0.010, 0.002)
"""How far the knuckle reaches beyond the hinge, outwards and upwards, and how far above the pot's
bottom it ends, in metres. It fills the room between the arms, so that no gripper can pinch it
together with one of them and lock the hinge."""

_ROOT = 0.002
"""How deep the knuckles reach into the wall, in metres: so that they end inside it."""

_STEEL = (0.66, 0.68, 0.71, 1.0)
_LID_COLOUR = (0.76, 0.77, 0.79, 1.0)
_HANDLE_COLOUR = (0.09, 0.09, 0.10, 1.0)

PLATE = (0.35, 0.28, 0.02)
"""Edges of the stove plate in metres [task definitions]."""
_BURNER = (0.105, 0.0005)
_PLATE_COLOUR = (0.13, 0.13, 0.15, 1.0)
_BURNER_COLOUR = (0.42, 0.16, 0.13, 1.0)


def pot(name: str) -> Prop:
    """A pot with the parts `left_handle` (+y) and `right_handle`; its frame is at its centre."""
    hinge = SE3.at(y=HINGE_OFFSET, z=HINGE_Z)
    return Prop(
        name=name,
        solid=_vessel(),
        parts=tuple(
            Part(
                name=f"{side}_handle",
                solid=_handle(),
                pose=SE3.at(yaw=yaw) @ hinge,
                hinge=Hinge(
                    axis=(-1.0, 0.0, 0.0),
                    limits=(-INWARDS, OUTWARDS),
                    stiffness=STIFFNESS,
                    damping=DAMPING,
                ),
            )
            for side, yaw in (("left", 0.0), ("right", math.pi))
        ),
    )


def _vessel() -> Solid:
    """The pot with its lid and the knuckles of its hinges, without its handles."""
    body = HEIGHT - LID_HEIGHT
    lid = prism(
        (RADIUS * circle(CIRCLE_SEGMENTS)).tolist(),
        LID_HEIGHT,
        at=SE3.at(z=(HEIGHT - LID_HEIGHT) / 2),
        rgba=_LID_COLOUR,
        taper=LID_TAPER,
        shadow=False,
    )
    return Solid(
        shapes=(
            cylinder(RADIUS, body, at=SE3.at(z=-LID_HEIGHT / 2)),
            lid,
            *(_knuckle(sign) for sign in (1, -1)),
        ),
        rgba=_STEEL,
        mass=MASS - 2 * mass_properties(_handle()).mass,
    )


def _knuckle(sign: int) -> Shape:
    """The block between the arms of a handle that carries its pin."""
    beyond, above, bottom = KNUCKLE
    inner = math.sqrt(RADIUS**2 - (BAR_LENGTH / 2) ** 2) - _ROOT
    outer = HINGE_OFFSET + beyond
    low, high = bottom - HEIGHT / 2, HINGE_Z + above
    at = SE3.at(y=sign * (inner + outer) / 2, z=(low + high) / 2)
    return box(BAR_LENGTH, outer - inner, high - low, at=at)


def _handle() -> Solid:
    """A bar along x on two arms, with its pin; its frame is on the hinge, its outside is +y."""
    y, z = HANDLE_OFFSET - HINGE_OFFSET, HANDLE_Z - HINGE_Z
    along_x = SE3.about((0, 1, 0), math.pi / 2)
    upright = SE3.about((1, 0, 0), -math.atan2(y, z))
    arms = [SE3.at(x=sign * (BAR_LENGTH + ARM) / 2, y=y / 2, z=z / 2) @ upright for sign in (-1, 1)]
    return Solid(
        shapes=(
            cylinder(BAR_RADIUS, BAR_LENGTH + ARM, at=SE3.at(y=y, z=z) @ along_x),
            *(box(ARM, ARM, math.hypot(y, z) + ARM, at=pose) for pose in arms),
            cylinder(BAR_RADIUS / 2, BAR_LENGTH + ARM, at=along_x),
        ),
        rgba=_HANDLE_COLOUR,
        density=ALUMINIUM_DENSITY,
    )


def stove_plate() -> Solid:
    """A flat plate with a burner on top; its frame is at the middle of its underside."""
    x, y, z = PLATE
    radius, height = _BURNER
    return Solid(
        shapes=(
            box(x, y, z, at=SE3.at(z=z / 2)),
            cylinder(radius, height, at=SE3.at(z=z + height / 2), rgba=_BURNER_COLOUR),
        ),
        rgba=_PLATE_COLOUR,
    )
