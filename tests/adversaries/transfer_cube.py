"""How one might cheat in transfer_cube."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from duobench.experts.handling import tool_for
from duobench.experts.handover import clasp, hanging, let_go, pick_bar, present, receive_pose
from duobench.experts.motion import CAREFUL, OPEN, Arms, Script, down, grip, move
from duobench.experts.scripts.transfer_cube import BAR, MEETING_POINT, RECEIVER_GRIP, RISE, SLANT
from duobench.objects.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.objects.bowl import RADIUS, RIM_HEIGHT
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.types import SIDES, Side
from tests.adversaries.adversary import Adversary, Hands
from tests.handovers import bring, clear_of, drop, lower, meet, pick_lying

LEFT, RIGHT = Side.LEFT, Side.RIGHT
NEAR_BOWL = 0
"""Seed of a layout in which both arms reach the bowl."""
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


def both_hold(arms: Arms) -> Script:
    yield from meet(arms, BAR, MEETING_POINT, rise=RISE, grip_at=RECEIVER_GRIP, slant=SLANT)


def hand_over(arms: Arms) -> Script:
    yield from both_hold(arms)
    yield from let_go(arms, RIGHT)


def into_bowl(arms: Arms, side: Side) -> Script:
    yield from bring(arms, side, "cube", arms.sim.position("bowl") + IN_BOWL)
    yield from drop(arms, side)


def lay_down(arms: Arms, side: Side) -> Script:
    yield from bring(arms, side, "cube", MIDDLE)
    yield from drop(arms, side)


def alone(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from into_bowl(arms, RIGHT)


def by_table(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from lay_down(arms, RIGHT)
    yield from clear_of(arms, RIGHT)
    yield from pick_lying(arms, LEFT, "cube")
    yield from into_bowl(arms, LEFT)


def keep(arms: Arms) -> Script:
    yield from both_hold(arms)
    yield from let_go(arms, LEFT)
    yield from clear_of(arms, LEFT)
    yield from into_bowl(arms, RIGHT)


def hand_back(arms: Arms) -> Script:
    yield from both_hold(arms)
    held_here = arms.targets[RIGHT]
    yield from let_go(arms, RIGHT)
    yield from clasp(arms, RIGHT, held_here)
    yield from let_go(arms, LEFT)
    yield from clear_of(arms, LEFT)
    yield from into_bowl(arms, RIGHT)


def fumble(arms: Arms) -> Script:
    yield from both_hold(arms)
    yield from drop(arms, *SIDES)
    yield from clear_of(arms, RIGHT)
    yield from pick_lying(arms, LEFT, "cube")
    yield from into_bowl(arms, LEFT)


def give_back_by_table(arms: Arms) -> Script:
    yield from hand_over(arms)
    yield from clear_of(arms, RIGHT)
    yield from lay_down(arms, LEFT)
    yield from clear_of(arms, LEFT)
    yield from pick_lying(arms, RIGHT, "cube")
    yield from into_bowl(arms, RIGHT)


def hand_over_once_then_by_table(arms: Arms) -> Script:
    yield from hand_over(arms)
    yield from clear_of(arms, RIGHT)
    yield from lay_down(arms, LEFT)
    yield from clear_of(arms, LEFT)
    yield from pick_lying(arms, RIGHT, "cube")
    yield from drop(arms, RIGHT)
    yield from clear_of(arms, RIGHT)
    yield from pick_lying(arms, LEFT, "cube")
    yield from into_bowl(arms, LEFT)


def throw(arms: Arms) -> Script:
    """Let go on the way to the bowl, at three quarters of a metre a second."""
    yield from hand_over(arms)
    bowl = arms.sim.position("bowl")
    shift = bowl + np.array([0.0, -0.25, 0.16]) - arms.sim.position("cube")
    yield from move(arms, {LEFT: arms.targets[LEFT].moved(*shift)})
    for _ in move(arms, {LEFT: arms.targets[LEFT].moved(y=0.30)}, speed=0.7, arrive=False):
        if math.dist(arms.sim.position("cube")[:2], bowl[:2]) < 0.20:
            arms.openings[LEFT.index] = OPEN
        yield


def drop_from_above_the_rim(height: float) -> Callable[[Arms], Script]:
    def script(arms: Arms) -> Script:
        yield from hand_over(arms)
        x, y, _ = arms.sim.position("bowl")
        yield from bring(arms, LEFT, "cube", (x, y, RIM_HEIGHT + height + LONG_BLOCK))
        yield from lower(arms, LEFT, "cube", RIM_HEIGHT + height)
        yield from drop(arms, LEFT)

    return script


def press_on_its_end(arms: Arms) -> Script:
    """Hold the block out to half-open fingers that push against its end, and put it in alone."""
    yield from pick_bar(arms, BAR)
    yield from move(arms, {RIGHT: present(BAR, MEETING_POINT, RISE)})
    yield from grip(arms, LEFT, opening=HALF_OPEN)
    end = receive_pose(arms, BAR, LONG_BLOCK / 2 + PAD_REACH, 0.0)
    for way in (-0.08, 0.006, -0.08):
        yield from move(arms, {LEFT: end @ SE3.at(z=way)}, speed=CAREFUL)
    yield from clear_of(arms, LEFT)
    yield from into_bowl(arms, RIGHT)


def tip_over_the_rim(arms: Arms) -> Script:
    """Stand the block beside the bowl, and knock it over."""
    yield from hand_over(arms)
    x, y, _ = arms.sim.position("bowl")
    standing = SE3(hanging(arms, LEFT, "cube").rotation, np.array([x, y - 0.103, LONG_BLOCK / 2]))
    for height in (0.10, 0.002):
        goal = tool_for(arms, LEFT, "cube", standing.moved(z=height))
        yield from move(arms, {LEFT: goal}, speed=0.2)
    yield from drop(arms, LEFT)
    yield from move(arms, {LEFT: arms.targets[LEFT].moved(y=-0.15)})
    yield from grip(arms, LEFT)
    yield from move(arms, {LEFT: down(x, y - 0.2, 0.085)})
    yield from move(arms, {LEFT: down(x, y - 0.05, 0.085)}, speed=0.2)
    yield from move(arms, {LEFT: down(x, y - 0.2, 0.2)})


cheat = partial(Adversary, deed=ends_in_bowl, seed=NEAR_BOWL)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("one arm picks the block up and puts it into the bowl", alone, 1, hands=Hands.ONE),
    cheat("the block is laid on the table for the other arm", by_table, 1, hands=Hands.TURNS),
    cheat("the other arm grasps the block as well, and lets go again", keep, 2),
    cheat("the block is handed back", hand_back, 3),
    cheat("both arms hold the block and drop it, and the other one picks it up", fumble, 2),
    cheat("the block is given back by way of the table", give_back_by_table, 3),
    cheat(
        "the block is handed over once, and once more by way of the table",
        hand_over_once_then_by_table,
        3,
    ),
    cheat("the block is thrown into the bowl", throw, 3),
    *(
        cheat(
            f"the block is dropped into the bowl from {1000 * height:.0f} mm above its rim",
            drop_from_above_the_rim(height),
            3,
            lacks="when left let cube go: cube is ",
        )
        for height in (0.15, 0.25)
    ),
    cheat("the other arm presses half-open fingers on the block's end", press_on_its_end, 1),
    cheat("the block is tipped over the rim into the bowl", tip_over_the_rim, 3),
)
