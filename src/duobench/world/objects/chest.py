"""A small chest with a lid that its own weight shuts, screwed to the table.

The chest's frame is at the middle of its underside: x towards the hinge, z up. The lid's frame is
on the hinge's axis, so that the shut lid reaches towards -x; the hinge turns about +y to open.

Two posts behind the hinge stop the lid short of upright, so that its weight always has a lever.
"""

import math

from duobench.core.spatial import SE3
from duobench.world.objects.prop import Hinge, Part, Prop
from duobench.world.objects.shapes import (
    CIRCLE_SEGMENTS,
    OVERLAP,
    Colour,
    Shape,
    box,
    cylinder,
    prism,
)
from duobench.world.objects.solid import (
    Solid,
    mesh_of,
    placed,
    union_of,
)

CAVITY = (0.130, 0.230, 0.060)
"""Depth, width and height of the cavity in metres [task definitions]."""
WALL = 0.006
"""Thickness of walls, floor and lid in metres [task definitions]."""
RIM_HEIGHT = WALL + CAVITY[2]
"""Height of the rim above the table in metres."""
LID_LIMITS = (0.0, math.radians(80.0))
"""Range of the lid in radians; the posts stop it there in print [task definitions]."""
LID_DAMPING = 0.03
"""Damping of the lid in N·m·s/rad: screws in printed holes. There is no spring [task definitions];
let go at its stop, the lid is shut in half a second, without a bang."""

GAP = 0.001
"""Play between the shut lid and the rim, and between lid and lugs, in metres."""
BARREL_RADIUS = 0.005
"""Outer radius of the hinge's barrel in metres."""
HOLE_RADIUS = 0.0016
"""Radius in metres of the hole in a lug, in which an M3 screw turns: 0.1 mm of play a side."""
THREAD_RADIUS = 0.0014
"""Radius in metres of the hole in the barrel, into which an M3 screw cuts its thread. Two screws of
20 mm [task definitions], one from either side, reach 13 mm into the barrel and are the hinge."""
LIP = 0.038
"""How far the lid stands out over the front, all along it, in metres: the tab that a finger lifts.
Closed fingertips are 32 mm thick, but the linkage behind them is 126 mm wide, so that a hand that
reaches in from the side needs the tab near the lid's end."""
LUG = (0.016, 0.012)
"""Length along x of a lug that carries the hinge, and how far it reaches above the rim."""
POST_WIDTH, POST_DEPTH = 0.012, 0.020
"""Width of a post that stops the lid, and how far it stands out at the back, in metres."""
POST_Y = 0.080
"""Distance of the posts from the middle, in metres."""
POST_PLAY = 0.0002
"""Play between a post and the lid at its stop, in metres: the hinge's limit acts first."""
POST_REACH = (0.022, 0.034)
"""Distances at which the posts meet the lid, in metres from the hinge's axis: above the barrel, and
far enough from the axis for a print to bear a push at the lip."""
POST_FOOT = 0.009
"""Distance behind the hinge's axis at which the posts pass the barrel, in metres."""

OUTER_X, OUTER_Y = CAVITY[0] + 2 * WALL, CAVITY[1] + 2 * WALL
"""Outer depth and width in metres."""
LID_LENGTH = OUTER_X
"""Distance from the hinge's axis to the lid's front edge without lip, in metres."""
LID_WIDTH = CAVITY[1] - 2 * GAP
HINGE = (OUTER_X / 2, 0.0, RIM_HEIGHT + GAP + BARREL_RADIUS)
"""The hinge's axis in the chest's frame, in metres."""
LID_UNDERSIDE = -BARREL_RADIUS
"""Underside of the lid in its own frame, in metres."""


def chest(
    name: str,
    *,
    body: Colour,
    lid: Colour,
) -> Prop:
    """A chest that stands where its layout puts it, with its lid as part `lid`."""
    hinge = Hinge(axis=(0.0, 1.0, 0.0), limits=LID_LIMITS, damping=LID_DAMPING)
    return Prop(
        name=name,
        solid=lambda: chest_box(body),
        parts=(
            Part(
                name="lid",
                solid=lambda: chest_lid(lid),
                pose=SE3.at(*HINGE),
                hinge=hinge,
            ),
        ),
        fixed=True,
    )


def chest_box(rgba: Colour) -> Solid:
    """The open box with two lugs for the hinge's screws and two posts that stop the lid."""
    depth, width, _ = CAVITY
    lug_height = RIM_HEIGHT + LUG[1]
    shapes = [
        box(
            OUTER_X,
            OUTER_Y,
            WALL,
            at=SE3.at(0, 0, WALL / 2),
        )
    ]
    for sign in (-1, 1):
        x, y = sign * (depth + WALL) / 2, sign * (width + WALL) / 2
        shapes += [
            box(
                WALL,
                OUTER_Y,
                RIM_HEIGHT,
                at=SE3.at(x, 0, RIM_HEIGHT / 2),
            ),
            box(
                OUTER_X,
                WALL,
                RIM_HEIGHT,
                at=SE3.at(0, y, RIM_HEIGHT / 2),
            ),
            box(
                LUG[0],
                WALL,
                lug_height,
                at=SE3.at(HINGE[0], y, lug_height / 2),
            ),
            *_post(sign * POST_Y),
        ]
    return _drilled(tuple(shapes), rgba, SE3.at(*HINGE), HOLE_RADIUS)


def _post(y: float) -> tuple[Shape, Shape]:
    """A post behind the back wall: its head leans over the barrel as the open lid leans to it.

    The head reaches into the foot, further back there than where it leaves it.
    """
    stop = SE3.about((0, 1, 0), LID_LIMITS[1])
    low, high = (
        stop.apply([-s, 0.0, LID_UNDERSIDE + WALL + POST_PLAY]) for s in POST_REACH
    )
    rim = RIM_HEIGHT - HINGE[2]
    outline = (
        (POST_FOOT, rim),
        (low[0], low[2]),
        (high[0], high[2]),
        (POST_DEPTH, high[2]),
        (POST_DEPTH, rim - OVERLAP),
        (POST_FOOT + OVERLAP, rim - OVERLAP),
    )
    along_y = SE3.at(HINGE[0], y, HINGE[2]) @ SE3.about((1, 0, 0), math.pi / 2)
    depth = POST_DEPTH + WALL
    foot = SE3.at(HINGE[0] - WALL + depth / 2, y, RIM_HEIGHT / 2)
    return box(
        depth,
        POST_WIDTH,
        RIM_HEIGHT,
        at=foot,
    ), prism(outline, POST_WIDTH, at=along_y)


def chest_lid(rgba: Colour) -> Solid:
    """The lid with the barrel of its hinge and the lip at its front."""
    length = LID_LENGTH + LIP
    along_y = SE3.about((1, 0, 0), math.pi / 2)
    shapes = (
        box(
            length, LID_WIDTH, WALL, at=SE3.at(-length / 2, 0, LID_UNDERSIDE + WALL / 2)
        ),
        cylinder(BARREL_RADIUS, LID_WIDTH, at=along_y),
    )
    return _drilled(shapes, rgba, SE3(), THREAD_RADIUS)


def _drilled(
    shapes: tuple[Shape, ...], rgba: Colour, axis: SE3, radius: float
) -> Solid:
    """The union of shapes with a hole for the hinge's screws along y through `axis`."""
    import manifold3d

    # A value of its own: in one expression with the hole, the triangles would be others.
    whole = union_of(shapes)
    drill = manifold3d.Manifold.cylinder(
        2 * OUTER_Y, radius, radius, CIRCLE_SEGMENTS // 2, True
    )
    hole = placed(drill, axis @ SE3.about((1, 0, 0), math.pi / 2))
    return Solid(shapes=shapes, rgba=rgba, mesh=mesh_of(whole - hole))
