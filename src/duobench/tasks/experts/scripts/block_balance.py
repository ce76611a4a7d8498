"""Block-Balance: one arm lays the beam on the cube, then both put their blocks down together."""

import math

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.block_balance import BEAM, BLOCK, CUBE_EDGE
from duobench.tasks.experts.handling import pick, place, tool_for
from duobench.tasks.experts.motion import (
    Arms,
    Script,
    down,
    move,
    release,
    together,
    wait,
    wait_until,
)

_BEAM_SIDE = Side.RIGHT
_BEAM_GRASP = 0.014
"""Height of the tool above the beam's middle: the fingertips then clear the table."""
_BEAM_SPEED = 0.35
"""Mean speed in m/s with which an arm comes to the beam: its elbow swings little at any tempo."""
_BEAM_FREEDOM = 0.5
"""Share of a variety's grasp offset at which the beam does not yet swing about the fingers."""
_BEAM_GAP = 0.001
"""Height above the cube at which the beam is led, in metres."""
_BLOCK_GRASP = 0.018
"""Height of the tool above a block's middle, in metres: the pads hold it."""
_REACH = 0.078
"""Distance of a block from the middle of the beam: at its end, but wholly on it."""
_GAP = -0.0005
"""Height in metres of the blocks above the beam: so that both stand on it when let go."""
_OUTWARD = {Side.LEFT: math.pi / 2, Side.RIGHT: -math.pi / 2}
"""Yaw at which the fingers open along x and the wrist camera points away from the other arm."""


def script(arms: Arms) -> Script:
    """Lay the beam, take both blocks, put them down together, let go together."""
    yield from lay_beam(arms)
    yield from together(*(take_block(arms, side) for side in SIDES))
    yield from lower(arms)
    yield from release(arms, *SIDES)
    yield from wait(4)
    yield from move(
        arms, {side: arms.targets[side].moved(z=0.15) for side in SIDES}, speed=0.2
    )


def lower(
    arms: Arms,
    *sides: Side,
    reach: float = _REACH,
    gap: float = _GAP,
) -> Script:
    """Carry held blocks over the beam and lower them together; both where no side is given.

    Args:
        arms: The arms.
        sides: The arms that put their blocks down.
        reach: Distance of a block from the middle of the beam, in metres.
        gap: Height above the beam to which the blocks are led, in metres.
    """
    sides = sides or SIDES
    beam = arms.sim.pose("beam")
    goals: dict[Side, SE3] = {}
    for side in sides:
        end = beam.apply([0.0, side.sign * reach, 0.0])
        height = beam.translation[2] + BEAM[2] / 2 + BLOCK[2] / 2 + gap
        goal = SE3.at(
            end[0],
            end[1],
            height,
            yaw=beam.yaw,
        )
        goals[side] = tool_for(arms, side, _block(side), goal)
    yield from move(
        arms, {side: goal.moved(z=0.08) for side, goal in goals.items()}, speed=0.3
    )
    yield from wait(8)
    yield from move(arms, goals, speed=0.06)
    touches = arms.sim.contacts.between
    yield from wait_until(
        lambda: all(touches(_block(side), "beam") for side in sides), 15
    )


def lay_beam(
    arms: Arms, side: Side | None = None, along: float = 0.0, gap: float = _BEAM_GAP
) -> Script:
    """Put the beam across the cube.

    Args:
        arms: The arms.
        side: The arm that lays it.
        along: Where it grasps the beam, from its middle, in metres.
        gap: Height above the cube to which the beam is led, in metres.
    """
    beam = arms.sim.pose("beam")
    x, y, z = beam.apply([0.0, along, _BEAM_GRASP])
    side = side or arms.variety.ordered((_BEAM_SIDE, _BEAM_SIDE.other), y)[0]
    yield from pick(
        arms,
        side,
        down(
            x,
            y,
            z,
            yaw=beam.yaw + _OUTWARD[side],
        ),
        speed=_BEAM_SPEED,
        freedom=_BEAM_FREEDOM,
    )
    x, y, _ = arms.sim.position("cube")
    goal = tool_for(arms, side, "beam", SE3.at(x, y, CUBE_EDGE + BEAM[2] / 2 + gap))
    yield from place(
        arms,
        side,
        goal,
        above=0.06,
        retreat=0.15,
        speed=0.3,
    )


def take_block(
    arms: Arms,
    side: Side,
    height: float = _BLOCK_GRASP,
) -> Script:
    """Pick up the block on an arm's side, with the tool at a height above the block's middle."""
    pose = arms.sim.pose(_block(side))
    x, y, z = pose.translation
    grasp = down(
        x,
        y,
        z + height,
        yaw=_OUTWARD[side],
    )
    yield from pick(
        arms,
        side,
        grasp,
        above=0.12,
        lift=0.12,
    )


def _block(side: Side) -> str:
    return f"{side}_block"
