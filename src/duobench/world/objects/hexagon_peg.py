"""A hexagonal peg, and a board with three holes of which one takes it."""

import math
from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import SE3
from duobench.world.objects.shapes import (
    Z_TO_X,
    Array,
    Colour,
    Shape,
    box,
    circle,
    hull,
)
from duobench.world.objects.solid import (
    Solid,
    manifold_of,
    mesh_of,
    placed,
)

ACROSS_FLATS = 0.034
"""Distance between opposite faces of the peg in metres [task definitions]."""
PEG_LENGTH = 0.100
"""Length of the peg, along x, in metres [task definitions]."""
CLEARANCE = 0.001
"""Play on each side of the peg in its hole, in metres [task definitions]."""
PEG_PRINT_TURN = SE3.about((0, 1, 0), -math.pi / 2)
"""The peg is printed upright, so that the hexagon is the printer's plane."""

CELL = (0.060, 0.070)
"""Length (along x) and width of the board around each hole, in metres."""
BOARD_HEIGHT = 0.030
BOARD_FLOOR = 0.004
"""Height of the board and thickness of its floor in metres: a standing peg goes 26 mm deep."""
CHAMFER = 0.003
"""Width and depth of the chamfer around each hole in metres: three times the play."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PolygonHole:
    """A regular polygon in the board."""

    corners: int
    """Number of corners."""
    apothem: float
    """Distance from the middle to the sides in metres."""
    x: float
    """Position of its middle along the board, in metres."""

    phase: float
    """Direction of a corner in radians from the x axis."""

    def outline(self, grown: float = 0.0) -> Array:
        """Corners (n, 2) around the middle, with every side moved outwards by `grown` metres."""
        radius = (self.apothem + grown) / math.cos(math.pi / self.corners)
        return radius * circle(self.corners, self.phase)


HEXAGON = PolygonHole(
    corners=6, apothem=ACROSS_FLATS / 2 + CLEARANCE, x=-CELL[0], phase=0.0
)
SQUARE = PolygonHole(
    corners=4,
    apothem=0.017,
    x=0.0,
    phase=math.pi / 4,
)
"""34 mm wide; the peg needs 37.9 mm, however it is turned."""
TRIANGLE = PolygonHole(
    corners=3,
    apothem=0.012,
    x=CELL[0],
    phase=math.pi / 2,
)
"""Its largest circle is 24 mm wide; the peg's is 34 mm."""
HOLES = (HEXAGON, SQUARE, TRIANGLE)


def peg(rgba: Colour) -> Solid:
    """The peg, along x; its frame is at its centre, with two faces up and down (z).

    Three boxes, each between two opposite faces, make up the hexagonal prism exactly.
    """
    import manifold3d

    side = ACROSS_FLATS / math.sqrt(3.0)
    turns = (SE3.about((1, 0, 0), k * math.pi / 3) for k in range(3))
    outline = manifold3d.CrossSection([(side * circle(6)).tolist()])
    exact = outline.extrude(PEG_LENGTH).translate((0.0, 0.0, -PEG_LENGTH / 2))
    return Solid(
        shapes=tuple(
            box(
                PEG_LENGTH,
                side,
                ACROSS_FLATS,
                at=turn,
            )
            for turn in turns
        ),
        rgba=rgba,
        mesh=mesh_of(placed(exact, Z_TO_X)),
    )


def socket_board(rgba: Colour) -> Solid:
    """The board with its holes along x; its frame is at the middle of its underside."""
    import manifold3d

    length, width = CELL[0] * len(HOLES), CELL[1]
    floor = box(
        length,
        width,
        BOARD_FLOOR,
        at=SE3.at(z=BOARD_FLOOR / 2),
    )
    exact = manifold_of(
        box(
            length,
            width,
            BOARD_HEIGHT,
            at=SE3.at(z=BOARD_HEIGHT / 2),
        )
    )
    for hole in HOLES:
        shaft = manifold3d.CrossSection([hole.outline().tolist()])
        exact -= shaft.extrude(BOARD_HEIGHT).translate((hole.x, 0.0, BOARD_FLOOR))
        wide = (hole.apothem + CHAMFER) / hole.apothem
        mouth = shaft.extrude(CHAMFER, scale_top=(wide, wide))
        exact -= mouth.translate((hole.x, 0.0, BOARD_HEIGHT - CHAMFER))
    walls = (wall for hole in HOLES for wall in _walls(hole))
    return Solid(shapes=(floor, *walls), rgba=rgba, mesh=mesh_of(exact))


def _walls(hole: PolygonHole) -> list[Shape]:
    """The board around a hole, in one convex piece for each of its sides."""
    shaft, mouth = hole.outline(), hole.outline(CHAMFER)
    half = np.array(CELL) / 2
    edge = shaft / np.abs(shaft / half).max(axis=1, keepdims=True)
    corners = np.array([(i, j) for i in (-1, 1) for j in (-1, 1)]) * half
    pieces = []
    for k in range(hole.corners):
        ends = [k, (k + 1) % hole.corners]
        # Corners of the board between the two rays that bound this piece.
        first, second = (np.column_stack([-edge[e, 1], edge[e, 0]])[0] for e in ends)
        between = corners[
            ((corners * first).sum(axis=1) > 0) & ((corners * second).sum(axis=1) < 0)
        ]
        rim = np.vstack([edge[ends], between])
        points = [
            *((x, y, z) for x, y in rim for z in (BOARD_FLOOR, BOARD_HEIGHT)),
            *(
                (x, y, z)
                for x, y in shaft[ends]
                for z in (BOARD_FLOOR, BOARD_HEIGHT - CHAMFER)
            ),
            *((x, y, BOARD_HEIGHT) for x, y in mouth[ends]),
        ]
        pieces.append(hull(points, at=SE3.at(x=hole.x)))
    return pieces
