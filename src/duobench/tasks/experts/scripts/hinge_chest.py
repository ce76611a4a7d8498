"""Hinge-Chest: the right arm lifts the lid with closed fingertips while the left brings the cube.

The right gripper comes from the right with its closed fingers along the chest's front, so that
they act as a rod under the lip: the rod need not turn while it follows the lid's arc, and the
hand stays out of the space above the cavity.
"""

import math
from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handling import pick_cube, put_in
from duobench.tasks.experts.motion import (
    CAREFUL,
    CLOSED,
    NEAR,
    Arms,
    Script,
    down,
    follow,
    grip,
    move,
    together,
)
from duobench.world.objects.chest import (
    HINGE,
    LID_LENGTH,
    LID_UNDERSIDE,
    OUTER_X,
)

HOLDER, INSERTER = Side.RIGHT, Side.LEFT
_SLOPE = 0.9
"""Angle in radians between the lifting fingers and the vertical."""
_ROD_Y = 0.112
"""How far to the holder's side along the front the lifting tool is, in the chest's frame: the
fingertips are under the end of the lip, the wide linkage behind them is beside the chest."""
_OVER_FRONT = 0.036
"""Distance in metres before the chest where the rod comes under the lip: the linkage clears it."""
_SLIDE = 0.035
"""How much further in under the lid the rod ends, in metres."""
_START = (-OUTER_X / 2 - _OVER_FRONT, 0.044)
"""Rod under the lip: x and z in the chest's frame."""
_OPEN_ANGLE = 1.32
"""Angle to which the lid is opened, in radians: clear of its stop."""
_NEARLY = 0.1
"""How much less than that is enough for the other arm to go in, in radians."""
_ROD_DEPTH = 0.016
"""Distance from the lid's underside to the rod's axis, in metres."""
_LIFT_SECONDS = 2.0

_WAIT_BESIDE = 0.24
"""Distance beside the chest's centre at which the cube waits, in metres."""
_CARRY_HEIGHT, _ABOVE_RIM = 0.20, 0.15
"""Heights of the tool in metres: carrying, over the open chest."""
_LEAN = 0.25
"""How far the inserting hand leans to its own side, in radians, away from the hand that holds the
lid."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Insertion:
    """How the cube is put in; the defaults are the expert's way."""

    side: Side = INSERTER
    """The arm that brings it; the other one holds the lid."""
    open_angle: float = _OPEN_ANGLE
    """How far the lid is opened, in radians."""
    place: tuple[float, float] = (-0.025, 0.045)
    """Place where the cube goes down, in the chest's frame."""
    tilt: float = 0.35
    """Lean of the inserting hand towards the robot in radians, so that its camera keeps clear of
    the lid."""
    yaw: float = 0.0
    """Turn of the inserting hand against the chest in radians: at 0 its camera is on the lid's side
    and its fingers open along the front."""
    grasp_height: float = 0.028
    """Height of the tool in metres when it grasps the cube on the table."""
    drop_height: float = 0.045
    """Height of the tool in metres when it lets the cube go."""


PLAIN = Insertion()


def script(arms: Arms) -> Script:
    """Open the chest, hold it open, put the cube in."""
    yield from insert(arms, PLAIN)


def insert(arms: Arms, way: Insertion) -> Script:
    """One arm opens the chest and holds it open while the other one puts the cube in."""
    enough = way.open_angle - _NEARLY

    def is_open() -> bool:
        return arms.sim.angle("chest/lid") >= enough

    bring = put_in(
        arms, way.side, fetch(arms, way), is_open, lower(arms, way), max_steps=300
    )
    yield from together(open_lid(arms, way), bring)


def _lifting(
    chest: SE3,
    holder: Side,
    x: float,
    z: float,
) -> SE3:
    """Tool pose of the rod at (x, z) of the chest's frame, camera towards the table."""
    rod = down(
        x,
        holder.sign * _ROD_Y,
        z,
        yaw=-holder.sign * math.pi / 2,
        tilt=_SLOPE,
    )
    return chest @ rod @ SE3.at(yaw=math.pi)


def under_lid(
    chest: SE3,
    holder: Side,
    angle: float,
) -> SE3:
    """Tool pose of the rod against the underside of the lid, open by `angle` radians."""
    reach = LID_LENGTH + _OVER_FRONT - _SLIDE * angle / _OPEN_ANGLE
    lid = SE3.about((0, 1, 0), angle).apply([-reach, 0.0, LID_UNDERSIDE - _ROD_DEPTH])
    return _lifting(chest, holder, HINGE[0] + lid[0], HINGE[2] + lid[2])


def open_lid(arms: Arms, way: Insertion = PLAIN) -> Script:
    """The holding arm lifts the lid and holds it."""
    chest, holder = arms.sim.pose("chest"), way.side.other
    start = _lifting(chest, holder, *_START)
    back = start @ SE3.at(0.0, 0.0, -0.13)
    arms.openings[holder.index] = CLOSED
    yield from move(arms, {holder: back}, tolerance=NEAR)
    yield from grip(arms, holder)
    yield from move(arms, {holder: start}, speed=0.2)
    yield from move(
        arms, {holder: under_lid(chest, holder, 0.0)}, speed=0.1, arrive=False
    )

    def up(fraction: float) -> dict[Side, SE3]:
        return {holder: under_lid(chest, holder, fraction * way.open_angle)}

    yield from follow(arms, up, _LIFT_SECONDS)


def fetch(arms: Arms, way: Insertion = PLAIN) -> Script:
    """The inserting arm picks up the cube and waits beside the chest."""
    yield from pick_cube(arms, way.side, "cube", way.grasp_height)
    y = arms.sim.position("chest")[1] + way.side.sign * _WAIT_BESIDE
    yield from move(arms, {way.side: over(arms, y, _CARRY_HEIGHT, way)}, tolerance=0.02)


def lower(arms: Arms, way: Insertion = PLAIN) -> Script:
    """The inserting arm brings the cube over the open chest, and down."""
    y = arms.sim.pose("chest").apply([*way.place, 0.0])[1]
    yield from move(arms, {way.side: over(arms, y, _ABOVE_RIM, way)}, tolerance=0.01)
    yield from move(
        arms, {way.side: over(arms, y, way.drop_height, way)}, speed=CAREFUL
    )


def over(
    arms: Arms,
    y: float,
    height: float,
    way: Insertion = PLAIN,
) -> SE3:
    """Tool pose of the inserting arm, at a place across the table and a height in metres."""
    chest = arms.sim.pose("chest")
    lean = SE3.about((1, 0, 0), -way.side.sign * _LEAN)
    turn = lean @ down(
        0.0,
        0.0,
        0.0,
        yaw=chest.yaw + way.yaw,
        tilt=way.tilt,
    )
    x = chest.apply([*way.place, 0.0])[0]
    return SE3(turn.rotation, np.array([x, y, height + arms.shorter]))
