"""A cooking pot with a bar handle on either side, and the stove plate it is put on."""

from __future__ import annotations

import math

import manifold3d
import numpy as np

from duobench.solids.prop import Part, Prop
from duobench.solids.shapes import CIRCLE_SEGMENTS, Colour, box, cylinder
from duobench.solids.solid import Solid, mesh_of
from duobench.spatial import SE3

RADIUS = 0.110
HEIGHT = 0.110
"""Outer radius and height in metres [task definitions]."""
WALL = 0.004
FLOOR = 0.004
"""Thickness of wall and floor in metres, as of a cast aluminium pot."""
ALUMINIUM_DENSITY = 2700.0
"""Density of aluminium in kg/m³; it makes the whole pot weigh 1.2 kg [task definitions]."""
WALL_SEGMENTS = 16
"""Boxes that make up the wall for collisions."""

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

STEEL = (0.70, 0.71, 0.73, 1.0)
HANDLE_COLOUR = (0.09, 0.09, 0.10, 1.0)

PLATE = (0.35, 0.28, 0.02)
"""Edges of the stove plate in metres [task definitions]."""
_BURNER = (0.105, 0.0005)
_PLATE_COLOUR = (0.13, 0.13, 0.15, 1.0)
_BURNER_COLOUR = (0.42, 0.16, 0.13, 1.0)


def pot(name: str) -> Prop:
    """A pot with the parts `left_handle` (+y) and `right_handle`; its frame is at its centre."""
    return Prop(
        name=name,
        solid=_vessel(STEEL),
        parts=(
            Part(name="left_handle", solid=_handle(), pose=SE3.at(z=HANDLE_Z)),
            Part(name="right_handle", solid=_handle(), pose=SE3.at(z=HANDLE_Z, yaw=math.pi)),
        ),
    )


def _vessel(rgba: Colour) -> Solid:
    """The pot without its handles."""
    inner, bottom, top = RADIUS - WALL, -HEIGHT / 2, HEIGHT / 2
    profile = manifold3d.CrossSection(
        [
            [
                [0, 0],
                [RADIUS, 0],
                [RADIUS, HEIGHT],
                [inner, HEIGHT],
                [inner, FLOOR],
                [0, FLOOR],
            ]
        ]
    )
    exact = manifold3d.Manifold.revolve(profile, CIRCLE_SEGMENTS).translate([0, 0, bottom])
    edge = 2 * RADIUS * math.tan(math.pi / WALL_SEGMENTS)
    walls = [
        SE3.about((0, 0, 1), 2 * math.pi * k / WALL_SEGMENTS)
        @ SE3(np.eye(3), np.array([RADIUS - WALL / 2, 0.0, (bottom + FLOOR + top) / 2]))
        for k in range(WALL_SEGMENTS)
    ]
    return Solid(
        shapes=(
            cylinder(RADIUS, FLOOR, at=SE3.at(z=bottom + FLOOR / 2)),
            *(box(WALL, edge, HEIGHT - FLOOR, at=pose) for pose in walls),
        ),
        rgba=rgba,
        mesh=mesh_of(exact),
        density=ALUMINIUM_DENSITY,
    )


def _handle() -> Solid:
    """A bar along x on the +y side of the pot's axis, with a stay at either end."""
    reach = HANDLE_OFFSET - RADIUS + WALL / 2
    bar = SE3.at(y=HANDLE_OFFSET) @ SE3.about((0, 1, 0), math.pi / 2)
    stays = [
        SE3.at(x=sign * (BAR_LENGTH + STAY) / 2, y=HANDLE_OFFSET + BAR_RADIUS - reach / 2)
        for sign in (-1, 1)
    ]
    return Solid(
        shapes=(
            cylinder(BAR_RADIUS, BAR_LENGTH, at=bar),
            *(box(STAY, reach, STAY, at=pose) for pose in stays),
        ),
        rgba=HANDLE_COLOUR,
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
