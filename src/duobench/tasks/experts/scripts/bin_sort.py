"""Bin-Sort: both arms pick and place at the same time, each the cube of its own half."""

from duobench.core.types import Side
from duobench.tasks.experts.handling import pick_cube, place
from duobench.tasks.experts.motion import (
    Arms,
    Script,
    down,
    together,
)

_GRASP_HEIGHT = 0.028
_DROP_HEIGHT = 0.045
_COLOUR = {Side.LEFT: "white", Side.RIGHT: "black"}


def script(arms: Arms) -> Script:
    """Sort both cubes."""
    yield from together(_sort(arms, Side.LEFT), _sort(arms, Side.RIGHT))


def _sort(arms: Arms, side: Side) -> Script:
    cube, bowl = f"{_COLOUR[side]}_cube", f"{_COLOUR[side]}_bowl"
    yield from pick_cube(arms, side, cube, _GRASP_HEIGHT)
    x, y, _ = arms.sim.position(bowl)
    yield from place(arms, side, down(x, y, _DROP_HEIGHT))
