"""Bars that plug into each other and onto a wall, along x."""

from __future__ import annotations

import math

import manifold3d
import numpy as np

from duobench.solids.shapes import Colour, Shape, box, hull
from duobench.solids.solid import Solid, mesh_of
from duobench.spatial import SE3

BAR = (0.075, 0.030, 0.025)
"""Length (along x), width and height of both bars in metres [task definitions]."""
PEG_WIDTH = 0.014
PEG_LENGTH = 0.018
"""Square peg and how far it stands out, in metres [task definitions]."""
CHAMFER_LENGTH = 0.005
CHAMFER_TAPER = 0.5
"""The tip narrows to half over its last 5 mm, so a peg a few millimetres off still finds in."""
CLEARANCE = 0.001
"""Play on each side of a peg in its socket, in metres [task definitions]."""
SOCKET_WIDTH = PEG_WIDTH + 2 * CLEARANCE
SOCKET_DEPTH = 0.020
"""Two millimetres deeper than the peg is long, so that the bars' faces meet first."""

WALL_PLATE = (0.020, 0.100, 0.085)
"""Depth, width and height of the wall in metres: low enough for a hand to reach over it."""
PEG_HEIGHT = 0.060
"""Height of the wall's peg above the table in metres [task definitions]."""

_ALONG_X = SE3(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
"""Rotation that turns z into x."""
LIGHT_TIP = SE3(_ALONG_X.rotation, np.array([BAR[0] / 2 + PEG_LENGTH, 0.0, 0.0]))
"""Tip of the light bar's peg in its frame, z outwards."""
FRONT_MOUTH = SE3(_ALONG_X.rotation, np.array([BAR[0] / 2, 0.0, 0.0]))
BACK_MOUTH = SE3(
    SE3.about((0, 0, 1), math.pi).rotation @ _ALONG_X.rotation, np.array([-BAR[0] / 2, 0.0, 0.0])
)
"""Mouths of the dark bar's sockets in its frame, z outwards."""
WALL_TIP = SE3(
    SE3.about((0, 0, 1), math.pi).rotation @ _ALONG_X.rotation,
    np.array([-WALL_PLATE[0] / 2 - PEG_LENGTH, 0.0, PEG_HEIGHT]),
)
"""Tip of the wall's peg in the wall's frame, z outwards, towards the robot."""


def _peg(root: SE3) -> tuple[Shape, ...]:
    """A chamfered square peg that stands on `root` along its z."""
    half, straight = PEG_WIDTH / 2, PEG_LENGTH - CHAMFER_LENGTH
    corners = [(i * half, j * half) for i in (-1, 1) for j in (-1, 1)]
    tip = [(CHAMFER_TAPER * x, CHAMFER_TAPER * y, CHAMFER_LENGTH) for x, y in corners]
    return (
        box(PEG_WIDTH, PEG_WIDTH, straight, at=root @ SE3.at(z=straight / 2)),
        hull([*((x, y, 0.0) for x, y in corners), *tip], at=root @ SE3.at(z=straight)),
    )


def light_bar(rgba: Colour) -> Solid:
    """The bar with a peg at its +x end; its frame is at the middle of the bar."""
    return Solid(shapes=(box(*BAR), *_peg(FRONT_MOUTH)), rgba=rgba)


def dark_bar(rgba: Colour) -> Solid:
    """The bar with a square socket at either end; its frame is at its middle."""
    length, width, height = BAR
    side, floor = (width - SOCKET_WIDTH) / 2, (height - SOCKET_WIDTH) / 2
    middle = length - 2 * SOCKET_DEPTH
    shapes = [box(middle, width, height)]
    for end in (-1, 1):
        x = end * (length - SOCKET_DEPTH) / 2
        for sign in (-1, 1):
            y, z = sign * (width - side) / 2, sign * (height - floor) / 2
            shapes.append(box(SOCKET_DEPTH, side, height, at=SE3.at(x, y, 0.0)))
            shapes.append(box(SOCKET_DEPTH, SOCKET_WIDTH, floor, at=SE3.at(x, 0.0, z)))
    exact = manifold3d.Manifold.cube(BAR, True)
    for end in (-1, 1):
        hole = manifold3d.Manifold.cube((SOCKET_DEPTH, SOCKET_WIDTH, SOCKET_WIDTH), True)
        exact -= hole.translate((end * (length - SOCKET_DEPTH) / 2, 0.0, 0.0))
    return Solid(shapes=tuple(shapes), rgba=rgba, mesh=mesh_of(exact))


def wall(rgba: Colour) -> Solid:
    """An upright plate with a peg towards the robot; its frame is under its middle."""
    depth, _, height = WALL_PLATE
    root = SE3(WALL_TIP.rotation, np.array([-depth / 2, 0.0, PEG_HEIGHT]))
    return Solid(shapes=(box(*WALL_PLATE, at=SE3.at(z=height / 2)), *_peg(root)), rgba=rgba)
