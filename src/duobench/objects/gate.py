"""An upright octagonal ring on a stand that is screwed to the table, and the mat beside it."""

from __future__ import annotations

import math

from duobench.objects.blocks import block
from duobench.objects.shapes import box
from duobench.objects.solid import Solid
from duobench.spatial import SE3

RING_RADIUS = 0.115
"""Radius of the circle that fits into the ring, in metres [task definitions]."""
RING_HEIGHT = 0.375
"""Height of the ring's centre above the table, in metres [task definitions]."""
RING_THICKNESS = 0.014
"""Width of the ring's bars, across and along its axis, in metres."""
SIDES_OF_RING = 8
POST = 0.030
"""Edge of the post's cross-section in metres."""
BASE = (0.20, 0.16, 0.016)
"""Base plate in metres: narrow enough to leave room for an arm's elbow on either side."""

MAT_EDGE, MAT_THICKNESS = 0.24, 0.010
"""Edge and thickness of the mat in metres [task definitions]."""

_STEEL = (0.30, 0.32, 0.35, 1.0)
_ORANGE = (0.93, 0.45, 0.10, 1.0)
_GREEN = (0.20, 0.62, 0.27, 1.0)


def gate() -> Solid:
    """The ring on its stand; the frame is under the middle of the base, the ring's axis is y."""
    middle = RING_RADIUS + RING_THICKNESS / 2
    length = 2 * (RING_RADIUS + RING_THICKNESS) * math.tan(math.pi / SIDES_OF_RING)
    bars = (
        box(
            length,
            RING_THICKNESS,
            RING_THICKNESS,
            at=SE3.at(z=RING_HEIGHT)
            @ SE3.about((0, 1, 0), 2 * math.pi * k / SIDES_OF_RING)
            @ SE3.at(z=middle),
            rgba=_ORANGE,
        )
        for k in range(SIDES_OF_RING)
    )
    foot, top = BASE[2], RING_HEIGHT - RING_RADIUS - RING_THICKNESS / 2
    return Solid(
        shapes=(
            box(*BASE, at=SE3.at(z=foot / 2)),
            box(POST, POST, top - foot, at=SE3.at(z=(top + foot) / 2)),
            *bars,
        ),
        rgba=_STEEL,
    )


def mat() -> Solid:
    """A green mat whose frame is at its centre."""
    return block(MAT_EDGE, MAT_EDGE, MAT_THICKNESS, _GREEN)
