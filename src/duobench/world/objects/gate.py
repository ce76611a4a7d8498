"""An upright octagonal ring on a stand that is screwed to the table, and the mat beside it."""

import math

from duobench.core.spatial import SE3
from duobench.world.objects.blocks import block
from duobench.world.objects.shapes import (
    JOINT_PLAY,
    OVERLAP,
    Shape,
    box,
)
from duobench.world.objects.solid import Piece, Solid

RING_RADIUS = 0.115
"""Radius of the circle that fits into the ring, in metres [task definitions]."""
RING_HEIGHT = 0.375
"""Height of the ring's centre above the table, in metres [task definitions]."""
RING_THICKNESS = 0.012
"""Width of the ring's bars, across and along its axis, in metres: 254 mm in all fit a printer."""
SIDES_OF_RING = 8
POST = 0.030
"""Edge of the post's cross-section in metres."""
BASE = (0.20, 0.16, 0.016)
"""Base plate in metres: narrow enough to leave room for an arm's elbow on either side."""
POST_DEPTH = 0.010
"""Depth of the post in the base plate, in metres: as printed, both are short enough."""
KEY = (0.010, 0.004)
"""Width and height in metres of the key on the post that keeps the ring from sliding sideways: the
lower bar lies in a slot of the post, and the key reaches into a notch in its underside."""

POST_PRINT_TURN = SE3.about((0, 1, 0), math.pi / 2)
RING_PRINT_TURN = SE3.about((1, 0, 0), math.pi / 2)
"""Post and ring are printed lying: the slot and the notch then have upright walls."""

MAT_EDGE, MAT_THICKNESS = 0.228, 0.010
"""Edge and thickness of the mat in metres [task definitions]."""

_STEEL = (0.30, 0.32, 0.35, 1.0)
_ORANGE = (0.93, 0.45, 0.10, 1.0)
_GREEN = (0.20, 0.62, 0.27, 1.0)


def gate() -> Solid:
    """The ring on its stand; the frame is under the middle of the base, the ring's axis is y.

    It is printed in three pieces, which are glued: the base, the post that stands in it, and the
    ring, whose lower bar lies in the top of the post.
    """
    plate = box(*BASE, at=SE3.at(z=BASE[2] / 2))
    foot, top = BASE[2] - POST_DEPTH, RING_HEIGHT - RING_RADIUS
    post = _upright(POST, POST, foot, top)
    wide = POST + 2 * JOINT_PLAY
    bars = _bars()
    return Solid(
        shapes=(*bars, plate, post),
        rgba=_STEEL,
        pieces=(
            Piece(
                name="base",
                shapes=(plate,),
                holes=(_upright(wide, wide, foot, BASE[2] + OVERLAP),),
            ),
            Piece(
                name="post",
                shapes=(post,),
                holes=_slot(top),
                print_turn=POST_PRINT_TURN,
            ),
            Piece(
                name="ring",
                rgba=_ORANGE,
                shapes=bars,
                holes=(_notch(top),),
                print_turn=RING_PRINT_TURN,
            ),
        ),
    )


def _bars() -> tuple[Shape, ...]:
    """The bars of the ring, which are as long as its outer edges and so overlap at its corners."""
    middle = RING_RADIUS + RING_THICKNESS / 2
    length = 2 * (RING_RADIUS + RING_THICKNESS) * math.tan(math.pi / SIDES_OF_RING)
    return tuple(
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


def _upright(
    x: float, y: float, low: float, high: float, *, at_x: float = 0.0
) -> Shape:
    """A box of x by y over the middle of the base, from one height to another."""
    return box(
        x,
        y,
        high - low,
        at=SE3.at(at_x, 0.0, (low + high) / 2),
    )


def _slot(top: float) -> tuple[Shape, ...]:
    """Cut in the post's top for the lower bar: all but the key."""
    width, height = KEY
    floor, across = top - RING_THICKNESS, RING_THICKNESS + 2 * JOINT_PLAY
    side = (POST - width) / 2 + OVERLAP
    return (
        _upright(POST + 2 * OVERLAP, across, floor + height, top + OVERLAP),
        *(
            _upright(
                side,
                across,
                floor,
                top,
                at_x=i * (width + side) / 2,
            )
            for i in (-1, 1)
        ),
    )


def _notch(top: float) -> Shape:
    """Cut in the lower bar for the key."""
    width, height = KEY
    floor = top - RING_THICKNESS
    across = RING_THICKNESS + 2 * OVERLAP
    return _upright(
        width + 2 * JOINT_PLAY, across, floor - OVERLAP, floor + height + JOINT_PLAY
    )


def mat() -> Solid:
    """A green mat whose frame is at its centre."""
    return block(MAT_EDGE, MAT_EDGE, MAT_THICKNESS, _GREEN)
