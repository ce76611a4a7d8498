"""Transfer-Cube: the right arm picks up, the left one takes over in the middle and puts down."""

import math

import numpy as np

from duobench.core.types import Side
from duobench.tasks.experts.handling import place
from duobench.tasks.experts.handover import (
    Bar,
    clasp,
    let_go,
    pick_bar,
    present,
    receive_pose,
    tool,
)
from duobench.tasks.experts.motion import (
    NEAR,
    Arms,
    Script,
    move,
    together,
)

BAR = Bar(
    body="cube",
    giver=Side.RIGHT,
    grip=0.026,
    height=0.028,
)
MEETING_POINT = np.array([0.50, 0.0, 0.32])
RISE = math.radians(25)
SLANT = math.radians(10)
RECEIVER_GRIP = 0.036
"""Place and angle from lengthwise at which the receiver clasps the cube: so near its end that the
end stays short of the finger linkage, and with enough slant that the hands stay clear of each
other."""
_READY = tool((0.50, 0.22, 0.38), along=(0.0, -0.6, -1.0), camera=(0.0, 1.0, 0.0))
_DROP_HEIGHT = 0.075


def script(arms: Arms) -> Script:
    """Hand the cube to the left arm, which puts it into the bowl."""
    giver, receiver = BAR.giver, BAR.giver.other
    yield from together(
        pick_bar(arms, BAR), move(arms, {receiver: _READY}, arrive=False)
    )
    yield from move(arms, {giver: present(BAR, MEETING_POINT, RISE)}, tolerance=NEAR)
    yield from clasp(arms, receiver, receive_pose(arms, BAR, RECEIVER_GRIP, SLANT))
    yield from let_go(arms, giver)
    x, y, _ = arms.sim.position("bowl")
    goal = tool((x, y, _DROP_HEIGHT), along=(0.0, -0.6, -1.0), camera=(0.0, 1.0, 0.0))
    yield from place(
        arms,
        receiver,
        goal,
        above=0.10,
        retreat=0.10,
    )
