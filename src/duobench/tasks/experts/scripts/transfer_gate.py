"""Transfer-Gate: the right arm reaches through the ring, the left one takes over behind it."""

import math

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handling import tool_for
from duobench.tasks.experts.handover import (
    Bar,
    clasp,
    hanging,
    let_go,
    pick_bar,
    present,
    receive_pose,
    tool,
    turn_to_camera,
)
from duobench.tasks.experts.motion import CAREFUL, NEAR, Arms, Script, move, together, wait_until
from duobench.world.objects.blocks import LONG_BLOCK
from duobench.world.objects.gate import MAT_THICKNESS, RING_HEIGHT

BAR = Bar(body="block", giver=Side.RIGHT, grip=0.026, height=0.028)
RISE = math.radians(45)
LEAN = math.radians(30)
"""How far bar and hands lean away from the robot at the ring, which stands so near to it that its
elbows were bent to their limits."""
RECEIVER_GRIP = 0.030
_BEFORE, BEYOND = -0.14, 0.020
"""Where the block's centre waits before the ring and where it is handed over, along its axis."""
_READY = tool((0.45, 0.30, 0.53), along=(-0.5, -1.0, -0.87), camera=(0.0, 1.0, -1.0))
_PRESS = 0.003
"""How far below the mat the block is led, in metres, so that it does touch."""
_TOUCH_STEPS = 15


def script(arms: Arms) -> Script:
    """Pass the block through the ring and put it on the mat."""
    giver, receiver = BAR.giver, BAR.giver.other
    yield from together(pick_bar(arms, BAR), move(arms, {receiver: _READY}, arrive=False))
    yield from reach_through(arms)
    yield from clasp(arms, receiver, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))
    yield from let_go(arms, giver)
    yield from together(leave(arms, giver), lower_onto_mat(arms, receiver))
    yield from let_go(arms, receiver)


def ring(arms: Arms) -> np.ndarray:
    """Centre (3,) of the ring."""
    return arms.sim.position("gate") + np.array([0.0, 0.0, RING_HEIGHT])


def reach_through(arms: Arms, beyond: float = BEYOND) -> Script:
    """Bring the block's free end through the ring, and its centre to a place along the axis."""
    before, through = (
        present(BAR, ring(arms) + np.array([0.0, y, 0.0]), RISE, LEAN) for y in (_BEFORE, beyond)
    )
    yield from move(arms, {BAR.giver: before})
    yield from move(arms, {BAR.giver: through}, speed=CAREFUL)


def leave(arms: Arms, side: Side) -> Script:
    """Take a hand out of the ring."""
    yield from move(arms, {side: arms.targets[side].moved(y=0.2 * side.sign)})


def lower_onto_mat(arms: Arms, side: Side) -> Script:
    """Stand the block on the mat, until it touches the mat."""
    yield from move(arms, {side: arms.targets[side].moved(x=0.06, y=0.12, z=0.03)}, arrive=False)
    x, y, _ = arms.sim.position("mat")
    standing = hanging(arms, side, BAR.body)
    turn = SE3.about((0, 0, 1), turn_to_camera(arms, side, BAR.body, standing)).rotation
    block = SE3(turn @ standing.rotation, np.array([x, y, MAT_THICKNESS + LONG_BLOCK / 2]))
    goal = tool_for(arms, side, BAR.body, block)
    yield from move(arms, {side: goal.moved(z=0.08)}, tolerance=NEAR)
    goal = tool_for(arms, side, BAR.body, block)
    yield from move(arms, {side: goal.moved(z=0.01)}, speed=CAREFUL)
    yield from move(arms, {side: goal.moved(z=-_PRESS)}, speed=0.05)
    yield from wait_until(lambda: arms.sim.contacts.between(BAR.body, "mat"), _TOUCH_STEPS)
