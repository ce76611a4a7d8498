"""Cubes and blocks."""

from duobench.world.objects.shapes import Colour, box
from duobench.world.objects.solid import Solid

BLACK = (0.04, 0.04, 0.045, 1.0)
"""Black plastic."""
CHARCOAL = (0.33, 0.33, 0.34, 1.0)
"""What a black cube lies in or under: black to the eye, and in any shadow a tenth of full
brightness lighter than the cube in the light's light."""
PALE = (0.72, 0.72, 0.73, 1.0)
"""Rim of a black bowl, by which it is seen as one."""
WHITE = (0.95, 0.95, 0.95, 1.0)
RED = (0.80, 0.10, 0.09, 1.0)
WOOD = (0.72, 0.53, 0.34, 1.0)
YELLOW = (0.93, 0.72, 0.13, 1.0)

CUBE_EDGE = 0.032
"""Edge of the small cubes in metres [task definitions]."""
LONG_BLOCK = 0.096
"""Length of the block that goes from hand to hand, in metres: so that two grippers fit [task
definitions]."""


def block(x: float, y: float, z: float, rgba: Colour) -> Solid:
    """A block with edges x, y, z in metres and a colour; its frame is at its centre."""
    return Solid(shapes=(box(x, y, z),), rgba=rgba)


def cube(rgba: Colour) -> Solid:
    """A cube with edges of 32 mm; its frame is at its centre."""
    return block(CUBE_EDGE, CUBE_EDGE, CUBE_EDGE, rgba)


def long_block(rgba: Colour) -> Solid:
    """A block of 96 x 32 x 32 mm, long along x; its frame is at its centre."""
    return block(LONG_BLOCK, CUBE_EDGE, CUBE_EDGE, rgba)
