"""Bin-Sort: both arms pick and place at the same time, each the cube of its own half."""

from __future__ import annotations

import math

from duobench.experts.motion import Arms, Script, down, nearest_turn, pick, place, together
from duobench.types import Side

_GRASP_HEIGHT = 0.028
_DROP_HEIGHT = 0.045
_COLOUR = {Side.LEFT: "white", Side.RIGHT: "black"}


def script(arms: Arms) -> Script:
    """Sort both cubes."""
    yield from together(_sort(arms, Side.LEFT), _sort(arms, Side.RIGHT))


def _sort(arms: Arms, side: Side) -> Script:
    cube, bowl = f"{_COLOUR[side]}_cube", f"{_COLOUR[side]}_bowl"
    while not arms.pinches(side, cube):
        pose = arms.sim.pose(cube)
        x, y, _ = pose.translation
        yaw = nearest_turn(pose.yaw, math.pi / 2)
        yield from pick(arms, side, down(x, y, _GRASP_HEIGHT, yaw=yaw))
    x, y, _ = arms.sim.position(bowl)
    yield from place(arms, side, down(x, y, _DROP_HEIGHT))
