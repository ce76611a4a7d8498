"""The fit coupon: pegs and sockets with several clearances, printed before anything else.

It says how far a printer is off. Each socket has as many dimples as its number; a peg that fits the
middle one as its recipe says needs no correction.
"""

import math

from duobench.printing.parts import PrintedPart, PrintJob, upright
from duobench.world.objects import hexagon_peg, joint_blocks
from duobench.world.objects.blocks import PALE, YELLOW
from duobench.world.objects.shapes import polygon
from duobench.world.objects.solid import mesh_of

ID = "coupon"
HEXAGON_PLAYS = (0.0008, 0.0009, 0.0010, 0.0011, 0.0012)
"""Play on each side of the hexagonal peg in its sockets, in metres; the third is the task's."""
SQUARE_PLAYS = (0.0002, 0.00025, 0.0003, 0.00035, 0.0004)
"""The same of the square peg."""
HEIGHT = 0.010
"""Height of the sockets in metres; they go through."""
PEG_HEIGHT = 0.020
WALL = 0.004
"""Least thickness of the walls in metres."""
DIMPLE = (0.0010, 0.0006, 0.003)
"""Radius, depth and distance of the dimples in metres."""


def fit_coupon() -> PrintJob:
    """Two pegs, and a plate with five sockets for each of them."""
    hexagon, square = (6, hexagon_peg.ACROSS_FLATS), (4, joint_blocks.PEG_WIDTH)
    return PrintJob(
        id=ID,
        title="Fit coupon",
        description="Pegs and sockets of the benchmark DuoBench with several clearances, printed "
        "first.",
        parts=(
            _peg("hexagon_peg", *hexagon),
            _plate("hexagon_sockets", *hexagon, HEXAGON_PLAYS),
            _peg("square_peg", *square),
            _plate("square_sockets", *square, SQUARE_PLAYS),
        ),
        notes=_notes(),
    )


def _peg(name: str, corners: int, across: float) -> PrintedPart:
    import manifold3d

    section = manifold3d.CrossSection([polygon(corners, across / 2)])
    return upright(name, mesh_of(section.extrude(PEG_HEIGHT)), YELLOW)


def _plate(name: str, corners: int, across: float, plays: tuple[float, ...]) -> PrintedPart:
    """A plate with sockets in a row along x, and dimples that number them in front of each."""
    import manifold3d

    m = manifold3d.Manifold
    radius, depth, apart = DIMPLE
    step = across + 2 * plays[-1] + WALL
    tall = (across + 2 * plays[-1]) / (math.cos(math.pi / corners) if corners % 4 else 1)
    strip = 2 * WALL
    plate = m.cube((step * len(plays) + WALL, tall + 2 * WALL + strip, HEIGHT))
    plate = plate.translate((-step * len(plays) / 2 - WALL / 2, -tall / 2 - WALL - strip, 0.0))
    for number, play in enumerate(plays, 1):
        x = step * (number - (len(plays) + 1) / 2)
        hole = manifold3d.CrossSection([polygon(corners, (across + 2 * play) / 2)])
        plate -= hole.extrude(3 * HEIGHT).translate((x, 0.0, -HEIGHT))
        for dimple in range(number):
            at = x + apart * (dimple - (number - 1) / 2)
            pit = m.cylinder(2 * depth, radius, radius, 16, True)
            plate -= pit.translate((at, -tall / 2 - WALL - strip / 2, HEIGHT))
    return upright(name, mesh_of(plate), PALE)


def _notes() -> tuple[str, ...]:
    plays = {"hexagonal": HEXAGON_PLAYS, "square": SQUARE_PLAYS}
    return (
        *(
            f"Sockets 1 to {len(values)} of the {name} peg have a play of "
            f"{', '.join(f'{1000 * value:g}' for value in values)} mm on each side; each has as "
            "many dimples as its number."
            for name, values in plays.items()
        ),
        "Either peg should go through its socket 3 without force, however it is turned, as it does "
        "in simulation.",
        "If it needs force there, and goes through a higher one as it should, the printer makes "
        "holes too narrow: set its program's compensation of holes to the difference, and print "
        "the coupon again.",
    )
