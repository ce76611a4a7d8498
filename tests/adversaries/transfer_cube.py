"""How one might cheat in transfer_cube."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from duobench.experts.handling import tool_for
from duobench.experts.handover import hanging, let_go, pick_bar, present, receive_pose
from duobench.experts.motion import CAREFUL, OPEN, Arms, Script, down, grip
from duobench.experts.scripts.transfer_cube import BAR, MEETING_POINT, RECEIVER_GRIP, RISE, SLANT
from duobench.objects.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.objects.bowl import RADIUS, RIM_HEIGHT
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.types import SIDES, Array, Side
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.steps import Act, bring, by, clear_of, do, drop, hand_back, lower, meet, pick_lying, to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
MIDDLE = (0.48, 0.0, CUBE_EDGE / 2 + 0.002)
HALF_OPEN = 0.25
"""Opening at which both fingers meet the end of the block."""
PAD_REACH = 0.023
"""How far pads reach beyond the tool point, in metres."""
IN_BOWL = np.array([0.0, 0.0, 0.045])


def ends_in_bowl(sim: Simulation) -> bool:
    """The block lies in the bowl, and nobody touches it."""
    x, y, _ = sim.relative_position("cube", "bowl")
    return np.hypot(x, y) < RADIUS and sim.contacts.partners("cube") == {"bowl"}


def in_bowl(arms: Arms) -> Array:
    return arms.sim.position("bowl") + IN_BOWL


def into_bowl(side: Side) -> Act:
    return do((bring, side, "cube", in_bowl), (drop, side))


def by_table(side: Side) -> Act:
    """Lay the block on the table, where the other arm picks it up."""
    laid = do((bring, side, "cube", MIDDLE), (drop, side), (clear_of, side))
    return do(laid, (pick_lying, side.other, "cube"))


PICK = (pick_bar, BAR)
both_hold = do(
    partial(meet, bar=BAR, centre=MEETING_POINT, rise=RISE, grip_at=RECEIVER_GRIP, slant=SLANT)
)
hand_over = do(both_hold, (let_go, RIGHT))


def throw(arms: Arms) -> Script:
    """Let go on the way to the bowl, at three quarters of a metre a second."""
    bowl = arms.sim.position("bowl")
    shift = bowl + np.array([0.0, -0.25, 0.16]) - arms.sim.position("cube")
    yield from by(arms, LEFT, *shift)
    for _ in by(arms, LEFT, y=0.30, speed=0.7, arrive=False):
        if math.dist(arms.sim.position("cube")[:2], bowl[:2]) < 0.20:
            arms.openings[LEFT.index] = OPEN
        yield


def drop_from_above_the_rim(arms: Arms, height: float) -> Script:
    x, y, _ = arms.sim.position("bowl")
    yield from bring(arms, LEFT, "cube", (x, y, RIM_HEIGHT + height + LONG_BLOCK))
    yield from lower(arms, LEFT, "cube", RIM_HEIGHT + height)
    yield from drop(arms, LEFT)


def press_on_its_end(arms: Arms) -> Script:
    """Hold the block out to half-open fingers that push against its end."""
    yield from to(arms, RIGHT, present(BAR, MEETING_POINT, RISE))
    yield from grip(arms, LEFT, opening=HALF_OPEN)
    end = receive_pose(arms, BAR, LONG_BLOCK / 2 + PAD_REACH, 0.0)
    for way in (-0.08, 0.006, -0.08):
        yield from to(arms, LEFT, end @ SE3.at(z=way), speed=CAREFUL)


def tip_over_the_rim(arms: Arms) -> Script:
    """Stand the block beside the bowl, and knock it over."""
    x, y, _ = arms.sim.position("bowl")
    standing = SE3(hanging(arms, LEFT, "cube").rotation, np.array([x, y - 0.103, LONG_BLOCK / 2]))
    for height in (0.10, 0.002):
        goal = tool_for(arms, LEFT, "cube", standing.moved(z=height))
        yield from to(arms, LEFT, goal, speed=0.2)
    yield from drop(arms, LEFT)
    yield from by(arms, LEFT, y=-0.15)
    yield from grip(arms, LEFT)
    yield from to(arms, LEFT, down(x, y - 0.2, 0.085))
    yield from to(arms, LEFT, down(x, y - 0.05, 0.085), speed=0.2)
    yield from to(arms, LEFT, down(x, y - 0.2, 0.2))


cheat = cheats(ends_in_bowl)
AGAIN = do((pick_lying, LEFT, "cube"), into_bowl(LEFT))
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("one arm picks the block up and puts it into the bowl", 1, PICK, into_bowl(RIGHT), **ONE),
    cheat(
        "the block is laid on the table for the other arm",
        1,
        *(PICK, by_table(RIGHT), into_bowl(LEFT)),
        **TURNS,
    ),
    cheat(
        "the other arm grasps the block as well, and lets go again",
        2,
        *(both_hold, (let_go, LEFT), (clear_of, LEFT), into_bowl(RIGHT)),
    ),
    cheat("the block is handed back", 3, both_hold, (hand_back, RIGHT), into_bowl(RIGHT)),
    cheat(
        "both arms hold the block and drop it, and the other one picks it up",
        2,
        *(both_hold, (drop, *SIDES), (clear_of, RIGHT), AGAIN),
    ),
    cheat(
        "the block is given back by way of the table",
        3,
        *(hand_over, (clear_of, RIGHT), by_table(LEFT), into_bowl(RIGHT)),
    ),
    cheat(
        "the block is handed over once, and once more by way of the table",
        3,
        *(hand_over, (clear_of, RIGHT), by_table(LEFT), (drop, RIGHT), (clear_of, RIGHT), AGAIN),
    ),
    cheat("the block is thrown into the bowl", 3, hand_over, throw),
    *(
        cheat(
            f"the block is dropped into the bowl from {1000 * height:.0f} mm above its rim",
            3,
            *(hand_over, (drop_from_above_the_rim, height)),
            lacks="when left let cube go: cube is ",
        )
        for height in (0.15, 0.25)
    ),
    cheat(
        "the other arm presses half-open fingers on the block's end",
        1,
        *(PICK, press_on_its_end, (clear_of, LEFT), into_bowl(RIGHT)),
    ),
    cheat("the block is tipped over the rim into the bowl", 3, hand_over, tip_over_the_rim),
)
