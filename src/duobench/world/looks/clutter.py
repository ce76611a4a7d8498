"""Furniture along the walls of the room: visible, out of reach, and no part of the model."""

import colorsys
from dataclasses import dataclass

import numpy as np

from duobench.world.looks.colours import RGB
from duobench.world.robot.workcell import FLOOR_Z, ROOM_X, ROOM_Y

DEPTH = 0.35
"""How far from a wall a piece may reach, in metres: behind every camera for people."""
HEIGHTS = (0.25, 1.30)
"""Range of heights in metres; the lower camera for people looks over it."""
WIDTHS = (0.12, 0.45)
GAP = 0.05
"""Between a piece and the wall, in metres."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Furniture:
    """A box or an upright cylinder that stands on the floor."""

    position: tuple[float, float, float]
    """Centre in the table frame, in metres."""
    size: tuple[float, float, float]
    """Full size along x, y and z in metres."""
    colour: RGB
    """Red, green and blue, each 0 to 1."""
    is_round: bool
    """Whether it is a cylinder."""


def pieces(count: int, seed: int) -> tuple[Furniture, ...]:
    """Sample pieces of furniture from a seed; a larger count only adds pieces."""
    rng = np.random.Generator(np.random.PCG64([seed, *b"clutter"]))
    return tuple(_piece(rng) for _ in range(count))


def _piece(rng: np.random.Generator) -> Furniture:
    (x0, x1), (y0, y1) = ROOM_X, ROOM_Y
    width, height, depth = (
        rng.uniform(*ends)
        for ends in (WIDTHS, HEIGHTS, (0.4 * (DEPTH - GAP), DEPTH - GAP))
    )
    is_round = bool(rng.uniform() < 0.3)  # noqa: PLR2004 - three of ten
    if is_round:
        width = depth
    along, wall = rng.uniform(-1.0, 1.0), int(rng.integers(4))
    colour = colorsys.hsv_to_rgb(
        rng.uniform(), rng.uniform(0.2, 0.8), rng.uniform(0.25, 0.85)
    )
    inset = GAP + depth / 2
    if wall < 2:  # noqa: PLR2004 - the two walls across x
        x = (x0 + inset, x1 - inset)[wall]
        y = (y0 + y1) / 2 + along * ((y1 - y0) / 2 - width)
        size = depth, width, height
    else:
        y = (y0 + inset, y1 - inset)[wall - 2]
        x = (x0 + x1) / 2 + along * ((x1 - x0) / 2 - width)
        size = width, depth, height
    return Furniture(
        position=(float(x), float(y), FLOOR_Z + height / 2),
        size=size,
        colour=colour,
        is_round=is_round,
    )
