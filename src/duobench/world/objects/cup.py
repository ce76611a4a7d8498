"""An eight-sided cup, and marbles to fill it."""

from duobench.core.spatial import SE3
from duobench.world.objects.shapes import (
    Colour,
    circle,
    polygon,
    prism,
    ring_wall,
    sphere,
)
from duobench.world.objects.solid import Solid, mesh_of

WALLS = 8
INNER_RADIUS = 0.030
"""Distance from the axis to the inside of a wall, in metres [task definitions]."""
WALL = 0.004
"""Thickness of walls and floor in metres [task definitions]."""
HEIGHT = 0.075
"""Height in metres [task definitions]."""
ROOM = INNER_RADIUS, WALL, HEIGHT
"""Radius, floor and rim of the hollow in the cup's frame, in metres."""
OUTER_RADIUS = INNER_RADIUS + WALL
"""Distance from the axis to the outside of a wall; twice it fits the gripper's 85 mm stroke."""
MARK_HEIGHT = 0.0004
"""Thickness of a mark in metres."""

MARBLE_RADIUS = 0.005
"""Radius of a marble in metres [task definitions]."""
GLASS_DENSITY = 2500.0
"""Density of glass in kg/m³."""


def cup(rgba: Colour) -> Solid:
    """A cup whose frame is at the middle of its underside, z up, walls facing x and y."""
    import manifold3d

    outer = manifold3d.CrossSection([polygon(WALLS, OUTER_RADIUS)]).extrude(HEIGHT)
    inner = manifold3d.CrossSection([polygon(WALLS, INNER_RADIUS)]).extrude(HEIGHT)
    hollow = outer - inner.translate((0.0, 0.0, WALL))
    return Solid(
        shapes=(
            prism(polygon(WALLS, OUTER_RADIUS), WALL, at=SE3.at(0, 0, WALL / 2)),
            *ring_wall(
                WALLS,
                OUTER_RADIUS,
                WALL,
                HEIGHT - WALL,
                low=WALL,
            ),
        ),
        rgba=rgba,
        mesh=mesh_of(hollow),
    )


def square_mark(edge: float, rgba: Colour) -> Solid:
    """A coloured square on the table, thinner than paint and without contacts."""
    import manifold3d

    mark = manifold3d.Manifold.cube((edge, edge, MARK_HEIGHT), True)
    return Solid(shapes=(), rgba=rgba, mesh=mesh_of(mark))


def marble(rgba: Colour) -> Solid:
    """A polished glass marble: it rolls on other things, and slides past other marbles.

    Frictionless contacts among the marbles cost a third of those with friction.
    """
    return Solid(
        shapes=(sphere(MARBLE_RADIUS),),
        rgba=rgba,
        density=GLASS_DENSITY,
        friction=(0.3, 0.005, 0.0001),
        condim=1,
    )


HEAP = tuple(
    (x, y, WALL + MARBLE_RADIUS)
    for radius, count in (
        (0.0, 1),
        (2.08 * MARBLE_RADIUS, 6),
        (4.32 * MARBLE_RADIUS, 13),
    )
    for x, y in (radius * circle(count)).tolist()
)
"""Positions of twenty marbles in a full cup, without touching, in its frame and metres: rings of
one, six and thirteen."""
