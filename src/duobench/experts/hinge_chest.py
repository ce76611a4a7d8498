"""Hinge-Chest: the right arm lifts the lid with closed fingertips while the left brings the cube.

The right gripper comes from the right with its closed fingers along the chest's front, so that
they act as a rod under the lip: the rod need not turn while it follows the lid's arc, and the
hand stays out of the space above the cavity.
"""

from __future__ import annotations

import math

import numpy as np

from duobench.experts.motion import (
    CAREFUL,
    CLOSED,
    NEAR,
    Arms,
    Script,
    down,
    follow,
    grip,
    move,
    pick_cube,
    release,
    together,
    wait_until,
)
from duobench.objects.chest import HINGE, LID_LENGTH, LID_UNDERSIDE, OUTER_X
from duobench.spatial import SE3
from duobench.types import Side

HOLDER, INSERTER = Side.RIGHT, Side.LEFT
_SLOPE = 0.9
"""Angle in radians between the lifting fingers and the vertical."""
_ROD_Y = -0.112
"""Where along the front the lifting tool is, in the chest's frame: the fingertips are under the end
of the lip, the wide linkage behind them is beside the chest."""
_OVER_FRONT = 0.036
"""How far in front of the chest the rod comes under the lip, in metres: the linkage clears it."""
_SLIDE = 0.035
"""How much further in under the lid the rod ends, in metres."""
_START = (-OUTER_X / 2 - _OVER_FRONT, 0.044)
"""Rod under the lip: x and z in the chest's frame."""
_OPEN_ANGLE = 1.32
"""How far the lid is opened, in radians: clear of its stop."""
_ENOUGH = 1.22
"""Angle in radians from which on the other arm goes in."""
_ROD_DEPTH = 0.016
"""From the lid's underside to the rod's axis, in metres."""
_LIFT_SECONDS = 2.0

_DROP = (-0.025, 0.045)
"""Where the cube goes down, in the chest's frame."""
_GRASP_TILT = 0.35
"""Lean of the inserting hand towards the robot, so that its camera keeps clear of the lid."""
_WAIT_BESIDE = 0.24
"""How far to the left of the chest's centre the cube waits, in metres."""
_CARRY_HEIGHT, _ABOVE_RIM, _DROP_HEIGHT = 0.20, 0.15, 0.045
"""Heights of the tool in metres: carrying, over the open chest, letting go."""
_TILT = SE3.about((1, 0, 0), -0.25)
"""The inserting hand leans to its own side, away from the hand that holds the lid."""
_GRASP_HEIGHT = 0.028
LET_GO = 0.75
"""Opening that frees the cube and still fits between the walls."""


def script(arms: Arms) -> Script:
    """Open the chest, hold it open, put the cube in."""
    yield from together(open_lid(arms), bring(arms))


def bring(arms: Arms) -> Script:
    """The left arm puts the cube in as soon as the lid is open."""
    yield from fetch(arms)
    yield from wait_until(lambda: arms.sim.angle("chest/lid") >= _ENOUGH, 300)
    yield from lower(arms)
    yield from release(arms, INSERTER, opening=LET_GO)


def _lifting(chest: SE3, x: float, z: float) -> SE3:
    """Tool pose of the rod at (x, z) of the chest's frame, camera towards the table."""
    return chest @ down(x, _ROD_Y, z, yaw=math.pi / 2, tilt=_SLOPE) @ SE3.at(yaw=math.pi)


def _under_lid(chest: SE3, angle: float) -> SE3:
    """Tool pose of the rod against the underside of the lid, open by `angle` radians."""
    reach = LID_LENGTH + _OVER_FRONT - _SLIDE * angle / _OPEN_ANGLE
    lid = SE3.about((0, 1, 0), angle).apply([-reach, 0.0, LID_UNDERSIDE - _ROD_DEPTH])
    return _lifting(chest, HINGE[0] + lid[0], HINGE[2] + lid[2])


def open_lid(arms: Arms) -> Script:
    """The right arm lifts the lid and holds it."""
    chest = arms.sim.pose("chest")
    start = _lifting(chest, *_START)
    back = start @ SE3.at(0.0, 0.0, -0.13)
    arms.openings[HOLDER.index] = CLOSED
    yield from move(arms, {HOLDER: back}, tolerance=NEAR)
    yield from grip(arms, HOLDER)
    yield from move(arms, {HOLDER: start}, speed=0.2)
    yield from move(arms, {HOLDER: _under_lid(chest, 0.0)}, speed=0.1, arrive=False)
    yield from follow(arms, lambda f: {HOLDER: _under_lid(chest, f * _OPEN_ANGLE)}, _LIFT_SECONDS)


def fetch(arms: Arms) -> Script:
    """The left arm picks up the cube and waits beside the chest."""
    yield from pick_cube(arms, INSERTER, "cube", _GRASP_HEIGHT)
    y = arms.sim.position("chest")[1] + _WAIT_BESIDE
    yield from move(arms, {INSERTER: over(arms, y, _CARRY_HEIGHT)}, tolerance=0.02)


def lower(arms: Arms) -> Script:
    """The left arm brings the cube over the open chest, and down."""
    y = arms.sim.pose("chest").apply([*_DROP, 0.0])[1]
    yield from move(arms, {INSERTER: over(arms, y, _ABOVE_RIM)}, tolerance=0.01)
    yield from move(arms, {INSERTER: over(arms, y, _DROP_HEIGHT)}, speed=CAREFUL)


def over(arms: Arms, y: float, height: float) -> SE3:
    """Tool pose of the inserting arm, at a place across the table and a height in metres."""
    chest = arms.sim.pose("chest")
    turn = _TILT @ down(0.0, 0.0, 0.0, yaw=chest.yaw, tilt=_GRASP_TILT)
    return SE3(turn.rotation, np.array([chest.apply([*_DROP, 0.0])[0], y, height]))
