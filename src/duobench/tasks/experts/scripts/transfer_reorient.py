"""Transfer-Reorient: the left arm takes the peg lengthwise, so that it hangs from the hand."""

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
from duobench.tasks.experts.motion import (
    NEAR,
    SPEED,
    TURN_SPEED,
    Arms,
    Script,
    move,
    nearest_turn,
    together,
)
from duobench.world.objects.hexagon_peg import BOARD_HEIGHT, HEXAGON, PEG_LENGTH

BAR = Bar(
    body="peg",
    giver=Side.RIGHT,
    grip=0.028,
    height=0.027,
    freedom=0.2,
)
"""Turned faster or held less deep, the peg swivels in the hand."""
MEETING_POINT = np.array([0.50, 0.0, 0.38])
RISE = math.radians(60)
RECEIVER_GRIP = 0.032
_READY = tool((0.50, 0.25, 0.45), along=(0.0, -1.0, -1.0), camera=(0.0, 1.0, -1.0))
_ABOVE = (0.16, 0.06)
"""Heights of the peg above the board on its way, in metres. The elbow changes sides; lower down it
may get stuck half-way, nearly stretched, and the arm does not reach the board."""
_HEXAGON_TURN = math.pi / 3
_PRECISE = 0.001
"""Distance in metres at which the peg is over its hole."""


def script(arms: Arms) -> Script:
    """Hand the peg to the left arm, which inserts it."""
    giver, receiver = BAR.giver, BAR.giver.other
    yield from together(
        pick_bar(arms, BAR), move(arms, {receiver: _READY}, arrive=False)
    )
    meeting = {giver: present(BAR, MEETING_POINT, RISE)}
    yield from move(
        arms,
        meeting,
        speed=SPEED * arms.firmness,
        turn_speed=TURN_SPEED * arms.firmness,
        tolerance=NEAR,
        freedom=BAR.freedom,
    )
    yield from clasp(arms, receiver, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))
    yield from let_go(arms, giver)
    hole = arms.sim.pose("board") @ SE3.at(HEXAGON.x, 0.0, BOARD_HEIGHT)
    yield from insert(arms, receiver, hole)
    yield from let_go(arms, receiver)


def insert(
    arms: Arms,
    side: Side,
    hole: SE3,
) -> Script:
    """Turn the peg upright over a hole, look again from near, lower it."""
    goal = upright(arms, side, hole)
    for height in _ABOVE:
        yield from lead(
            arms,
            side,
            goal.moved(z=height),
            speed=0.4,
        )
    for height in (0.010, 0.004):
        yield from lead(
            arms,
            side,
            goal.moved(z=height),
            speed=0.12,
        )
    yield from lead(
        arms,
        side,
        goal.moved(z=-0.024),
        speed=0.06,
    )


def upright(
    arms: Arms,
    side: Side,
    hole: SE3,
) -> SE3:
    """Pose of the peg as it stands on a hole's mouth, turned like the hole, its hand above."""
    peg = hanging(arms, side, BAR.body)
    corner = math.atan2(peg.rotation[1, 1], peg.rotation[0, 1])
    comfortable = turn_to_camera(arms, side, BAR.body, peg)
    turn = SE3.about(
        (0, 0, 1), nearest_turn(hole.yaw - corner, _HEXAGON_TURN, comfortable)
    )
    goal = SE3(turn.rotation @ peg.rotation, hole.translation)
    return goal.moved(z=PEG_LENGTH / 2)


def lead(
    arms: Arms,
    side: Side,
    goal: SE3,
    *,
    speed: float,
) -> Script:
    """Bring the peg to a pose, from how it lies in the hand now."""
    pose = tool_for(arms, side, BAR.body, goal)
    yield from move(
        arms,
        {side: pose},
        speed=speed,
        tolerance=_PRECISE,
    )
