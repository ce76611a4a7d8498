"""Carry-Pot: both arms take a handle each and carry the pot as one rigid body."""

from __future__ import annotations

from duobench.experts.motion import (
    CAREFUL,
    Arms,
    Script,
    both,
    carry,
    come_down,
    down,
    grip,
    move,
    release,
)
from duobench.solids.pot import HANDLE_OFFSET, HANDLE_Z, HEIGHT, PLATE
from duobench.spatial import SE3
from duobench.types import SIDES, Side

_APPROACH = 0.10
"""Height in metres above the handles from which the tools come straight down."""
_OPENING = 0.45
"""Opening on the way down: wide enough for the bar, narrow enough for the gap to the wall."""
_FINGER_DEPTH = 0.004
"""How far the bar lies beyond the tool centre point: near the middle of the pads, in metres."""
_LIFT = 0.06
_CLEARANCE = 0.04
"""Height in metres of the pot above the table, and above the plate, while it is carried."""


def script(arms: Arms) -> Script:
    """Carry the pot to the middle of the stove plate."""
    while not all(arms.grasps(side, _handle(side)) for side in SIDES):
        yield from _grasp(arms)
    yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=_LIFT), speed=0.15)
    x, y, z = arms.sim.position("stove")
    goal = SE3.at(x, y, z + PLATE[2] + HEIGHT / 2, yaw=arms.sim.pose("pot").yaw)
    yield from carry(arms, "pot", goal.moved(z=_CLEARANCE), speed=CAREFUL)
    yield from carry(arms, "pot", goal, speed=0.12)
    yield from release(arms, *SIDES, opening=_OPENING)
    yield from move(arms, both(lambda side: arms.targets[side].moved(z=_APPROACH)), arrive=False)


def _grasp(arms: Arms) -> Script:
    """Close both grippers around the handles, from above."""
    pot = arms.sim.pose("pot")
    grasps = {side: _grasp_pose(pot, side) for side in SIDES}
    yield from come_down(arms, grasps, opening=_OPENING, above=_APPROACH)
    yield from grip(arms, *SIDES)


def _grasp_pose(pot: SE3, side: Side) -> SE3:
    """Where a tool grasps its handle."""
    x, y, z = pot.apply((0.0, side.sign * HANDLE_OFFSET, HANDLE_Z + _FINGER_DEPTH))
    return down(x, y, z, yaw=pot.yaw)


def _handle(side: Side) -> str:
    return f"pot/{side}_handle"
