"""A cooking pot with a bar handle on either side, and the stove plate it is put on."""

from __future__ import annotations

import math

from duobench.solids.prop import Part, Prop
from duobench.solids.shapes import CIRCLE_SEGMENTS, box, circle, cylinder, prism
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
"""Distance in metres of a handle's bar from the pot's axis: a finger fits between bar and wall."""
HANDLE_Z = 0.035
"""Height in metres of the bars above the pot's centre: above its centre of mass, so that a pot that
hangs from both handles hangs upright."""
BAR_RADIUS = 0.005
"""Radius of a handle's bar in metres. A round bar turns in a single gripper, because the friction
of the pads has so short a lever: this is what makes the pot a task for two arms."""
BAR_LENGTH = 0.080
"""Length in metres of a bar, between its two stays."""
STAY = 0.010
"""Edge in metres of the square stays that carry a bar."""

_ROOT = 0.002
"""How deep the stays reach into the wall, in metres: so that they end inside it."""

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
    return Prop(
        name=name,
        solid=_vessel(),
        parts=(
            Part(name="left_handle", solid=_handle(), pose=SE3.at(z=HANDLE_Z)),
            Part(name="right_handle", solid=_handle(), pose=SE3.at(z=HANDLE_Z, yaw=math.pi)),
        ),
    )


def _vessel() -> Solid:
    """The pot with its lid, without its handles."""
    body = HEIGHT - LID_HEIGHT
    lid = prism(
        (RADIUS * circle(CIRCLE_SEGMENTS)).tolist(),
        LID_HEIGHT,
        at=SE3.at(z=(HEIGHT - LID_HEIGHT) / 2),
        rgba=_LID_COLOUR,
        taper=LID_TAPER,
    )
    return Solid(
        shapes=(cylinder(RADIUS, body, at=SE3.at(z=-LID_HEIGHT / 2)), lid),
        rgba=_STEEL,
        mass=MASS - 2 * mass_properties(_handle()).mass,
    )


def _handle() -> Solid:
    """A bar along x on the +y side of the pot's axis, with a stay at either end."""
    corner = BAR_LENGTH / 2 + STAY
    inner, outer = math.sqrt(RADIUS**2 - corner**2) - _ROOT, HANDLE_OFFSET + BAR_RADIUS
    bar = SE3.at(y=HANDLE_OFFSET) @ SE3.about((0, 1, 0), math.pi / 2)
    stays = [SE3.at(x=sign * (BAR_LENGTH + STAY) / 2, y=(inner + outer) / 2) for sign in (-1, 1)]
    return Solid(
        shapes=(
            cylinder(BAR_RADIUS, BAR_LENGTH + STAY, at=bar),
            *(box(STAY, outer - inner, STAY, at=pose) for pose in stays),
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
