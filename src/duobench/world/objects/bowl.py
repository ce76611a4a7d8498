"""A shallow round bowl."""

from __future__ import annotations

from typing import TYPE_CHECKING

from duobench.core.spatial import SE3
from duobench.world.objects.shapes import (
    CIRCLE_SEGMENTS,
    Colour,
    cylinder,
    ring_wall,
)
from duobench.world.objects.solid import Image, Solid, mesh_of

if TYPE_CHECKING:
    import manifold3d

RADIUS = 0.085
"""Outer radius in metres [task definitions]."""
RIM_HEIGHT = 0.030
"""Height of the rim above the table in metres [task definitions]."""
WALL = 0.004
FLOOR = 0.004
"""Thickness of wall and floor in metres: ten lines of a printer's nozzle."""
RIM = 0.005
"""Height in metres of the part of the wall that has the rim's colour: two pixels of the head's
square image."""
WALL_SEGMENTS = 16
"""Boxes that make up the wall for collisions; a 32 mm cube cannot tell them from a circle. Their
corners stand out of the round print by 1.7 mm."""


def bowl(rgba: Colour, rim: Colour | None = None) -> Solid:
    """A bowl whose frame is at the middle of its underside, z up, with its rim in another colour.

    Args:
        rgba: Colour.
        rim: Colour of the rim, where it differs.
    """
    import manifold3d

    inner = RADIUS - WALL
    outside = [[0, 0], [RADIUS, 0], [RADIUS, RIM_HEIGHT]]
    inside = [[inner, RIM_HEIGHT], [inner, FLOOR], [0, FLOOR]]
    exact = manifold3d.CrossSection([outside + inside]).revolve(CIRCLE_SEGMENTS)
    return Solid(
        shapes=(
            cylinder(RADIUS, FLOOR, at=SE3.at(0, 0, FLOOR / 2)),
            *ring_wall(
                WALL_SEGMENTS,
                RADIUS,
                WALL,
                RIM_HEIGHT - FLOOR,
                low=FLOOR,
            ),
        ),
        rgba=rgba,
        mesh=mesh_of(exact),
        images=() if rim is None else _images(exact, rgba, rim),
    )


def _images(
    exact: manifold3d.Manifold,
    rgba: Colour,
    rim: Colour,
) -> tuple[Image, ...]:
    """The bowl below its rim, and the rim."""
    above, below = exact.split_by_plane((0.0, 0.0, 1.0), RIM_HEIGHT - RIM)
    return Image(mesh=mesh_of(below), rgba=rgba), Image(mesh=mesh_of(above), rgba=rim)
