"""Bars that plug into each other and onto a wall, along x."""

import math
from collections.abc import Iterator

import numpy as np

from duobench.core.spatial import SE3
from duobench.world.objects.shapes import (
    OVERLAP,
    Z_TO_X,
    Colour,
    Shape,
    box,
    hull,
)
from duobench.world.objects.solid import Solid, manifold_of, mesh_of

BAR = (0.075, 0.030, 0.025)
"""Length (along x), width and height of both bars in metres [task definitions]."""
PEG_WIDTH = 0.014
PEG_LENGTH = 0.024
"""Square peg and how far it stands out, in metres: long enough for what hangs on it."""
CHAMFER_LENGTH = 0.004
CHAMFER_TAPER = 0.55
"""The tip narrows by 3 mm a side over its last 4 mm, so a peg that is off by as much finds in."""
CLEARANCE = 0.0003
"""Play on each side of a peg in its socket, in metres, as a printer can [task definitions]: the
finished pair droops by about two degrees a joint, and friction keeps it on the wall (measured)."""
MOUTH = 0.001
"""Width and depth in metres of the chamfer around a socket's mouth."""
SOCKET_WIDTH = PEG_WIDTH + 2 * CLEARANCE
SOCKET_DEPTH = PEG_LENGTH + 0.002
"""Two millimetres deeper than the peg is long, so that the bars' faces meet first."""

WALL_PLATE = (0.020, 0.100, 0.085)
"""Depth, width and height of the wall in metres: low enough for a hand to reach over it."""
PEG_HEIGHT = 0.060
"""Height of the wall's peg above the table in metres [task definitions]."""

LIGHT_TIP = SE3.at(BAR[0] / 2 + PEG_LENGTH) @ Z_TO_X
"""Tip of the light bar's peg in its frame, z outwards."""
FRONT_MOUTH = SE3.at(BAR[0] / 2) @ Z_TO_X
BACK_MOUTH = SE3.at(-BAR[0] / 2, yaw=math.pi) @ Z_TO_X
"""Mouths of the dark bar's sockets in its frame, z outwards."""
WALL_TIP = (
    SE3.at(
        -WALL_PLATE[0] / 2 - PEG_LENGTH,
        0.0,
        PEG_HEIGHT,
        yaw=math.pi,
    )
    @ Z_TO_X
)
"""Tip of the wall's peg in the wall's frame, z outwards, towards the robot."""

LIGHT_PRINT_TURN = SE3.about((0, 1, 0), -math.pi / 2)
DARK_PRINT_TURN = LIGHT_PRINT_TURN
WALL_PRINT_TURN = SE3.about((0, 1, 0), math.pi / 2)
"""All three are printed with their pegs and sockets upright, so that the square is the printer's
plane, and without supports."""


def _peg(root: SE3) -> tuple[Shape, ...]:
    """A chamfered square peg that stands on `root` along its z and reaches a little below it."""
    half, straight = PEG_WIDTH / 2, PEG_LENGTH - CHAMFER_LENGTH
    shaft = box(
        PEG_WIDTH,
        PEG_WIDTH,
        straight + OVERLAP,
        at=root @ SE3.at(z=(straight - OVERLAP) / 2),
    )
    corners = [(i * half, j * half) for i in (-1, 1) for j in (-1, 1)]
    tip = [(CHAMFER_TAPER * x, CHAMFER_TAPER * y, CHAMFER_LENGTH) for x, y in corners]
    # Narrower than the shaft, so that what touches the peg's side touches the shaft alone.
    below = [(CHAMFER_TAPER * x, CHAMFER_TAPER * y, -OVERLAP) for x, y in corners]
    base = [(x, y, 0.0) for x, y in corners]
    return shaft, hull([*below, *base, *tip], at=root @ SE3.at(z=straight))


def light_bar(rgba: Colour) -> Solid:
    """The bar with a peg at its +x end; its frame is at the middle of the bar."""
    return Solid(shapes=(box(*BAR), *_peg(FRONT_MOUTH)), rgba=rgba)


def dark_bar(rgba: Colour) -> Solid:
    """The bar with a square socket, chamfered at its mouth, at either end; frame at its middle."""
    ends = (SE3(), SE3.at(yaw=math.pi))
    exact = manifold_of(box(*BAR))
    for end in ends:
        for hole in _hole(end):
            exact -= manifold_of(hole)
    middle = box(BAR[0] - 2 * SOCKET_DEPTH, BAR[1], BAR[2])
    walls = (wall for end in ends for wall in _walls(end))
    return Solid(shapes=(middle, *walls), rgba=rgba, mesh=mesh_of(exact))


def _hole(end: SE3) -> tuple[Shape, Shape]:
    """A socket as a solid: its shaft, and its mouth, at +x of `end`."""
    shaft = box(
        SOCKET_DEPTH,
        SOCKET_WIDTH,
        SOCKET_WIDTH,
        at=end @ SE3.at((BAR[0] - SOCKET_DEPTH) / 2),
    )
    rims = (
        (BAR[0] / 2 - MOUTH, SOCKET_WIDTH / 2),
        (BAR[0] / 2, SOCKET_WIDTH / 2 + MOUTH),
    )
    corners = [
        (x, i * half, j * half) for x, half in rims for i in (-1, 1) for j in (-1, 1)
    ]
    return shaft, hull(corners, at=end)


def _walls(end: SE3) -> Iterator[Shape]:
    """The bar around a socket at +x of `end`: a box on each side, a wedge where it has a chamfer.

    Those at the sides are as high as the bar, those above and below lie between them.
    """
    _, width, height = BAR
    shaft, face = BAR[0] / 2 - MOUTH, BAR[0] / 2
    half = SOCKET_WIDTH / 2
    length = SOCKET_DEPTH - MOUTH
    side, floor = width / 2 - half, height / 2 - half
    for sign in (-1, 1):
        y, z = sign * (half + side / 2), sign * (half + floor / 2)
        x = shaft - length / 2
        yield box(
            length,
            side,
            height,
            at=end @ SE3.at(x, y, 0.0),
        )
        yield box(
            length,
            SOCKET_WIDTH,
            floor,
            at=end @ SE3.at(x, 0.0, z),
        )
        rims = ((shaft, half), (face, half + MOUTH))
        sides = [
            (x, sign * y, j * height / 2)
            for x, inner in rims
            for y in (inner, width / 2)
            for j in (-1, 1)
        ]
        floors = [
            (x, j * inner, sign * z)
            for x, inner in rims
            for z in (inner, height / 2)
            for j in (-1, 1)
        ]
        yield hull(sides, at=end)
        yield hull(floors, at=end)


def wall(rgba: Colour) -> Solid:
    """An upright plate with a peg towards the robot; its frame is under its middle."""
    depth, _, height = WALL_PLATE
    root = SE3(WALL_TIP.rotation, np.array([-depth / 2, 0.0, PEG_HEIGHT]))
    return Solid(
        shapes=(box(*WALL_PLATE, at=SE3.at(z=height / 2)), *_peg(root)), rgba=rgba
    )
