"""How one might cheat in transfer_gate."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from duobench.experts.handover import clasp, let_go, pick_bar, present, receive_pose
from duobench.experts.motion import CAREFUL, OPEN, Arms, Script, down, grip, move
from duobench.experts.scripts.transfer_gate import (
    BAR,
    RECEIVER_GRIP,
    RISE,
    leave,
    lower_onto_mat,
    reach_through,
    ring,
)
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.gate import MAT_THICKNESS, RING_HEIGHT, RING_RADIUS
from duobench.sim.simulation import Simulation
from duobench.types import Side
from tests.adversaries.adversary import Adversary, Hands
from tests.handovers import bring, clear_of, drop, lower, pick_lying

LEFT, RIGHT = Side.LEFT, Side.RIGHT
NEAR_MAT = 0
"""Seed of a layout in which both arms reach the mat."""
ABOVE = 0.020
"""Height in metres above the mat from which the block is dropped."""
SHORT = -0.020
"""Where the block's centre is along the ring's axis, in metres, when it only reaches in."""
ASIDE = 0.26
"""Distance in metres from the ring's axis at which an arm leads the block around the ring."""


def ends_on_mat(sim: Simulation) -> bool:
    """The block lies on the mat, and nobody touches it."""
    return sim.contacts.partners("block") == {"mat"}


def onto_mat(arms: Arms, side: Side, *, height: float = 0.002) -> Script:
    """Put the block down on the mat, or let go of it from a height above."""
    x, y, _ = arms.sim.position("mat")
    yield from bring(arms, side, "block", (x, y, MAT_THICKNESS + CUBE_EDGE / 2 + height))
    yield from drop(arms, side)


def pull_back(arms: Arms) -> Script:
    before = present(BAR, ring(arms) + np.array([0.0, -0.16, 0.0]), RISE)
    yield from move(arms, {RIGHT: before}, speed=0.3)


def go_around(arms: Arms) -> Script:
    """Lead the block in the right arm around the ring to its far side."""
    for y in (-0.16, 0.03):
        yield from move(arms, {RIGHT: present(BAR, ring(arms) + np.array([ASIDE, y, 0.0]), RISE)})


def around_onto_mat(arms: Arms) -> Script:
    """Carry the block in the right arm around the ring and put it down on the mat."""
    x, y, z = ring(arms)
    yield from move(arms, {RIGHT: down(x, y - 0.20, z)})
    yield from move(arms, {RIGHT: down(x + ASIDE, y - 0.16, z)})
    yield from onto_mat(arms, RIGHT)


def take(arms: Arms) -> Script:
    """The left arm takes over where the right one presents the block."""
    yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))
    yield from let_go(arms, RIGHT)
    yield from leave(arms, RIGHT)


def hand_over(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms)
    yield from take(arms)


def finish(arms: Arms) -> Script:
    yield from lower_onto_mat(arms, LEFT)
    yield from drop(arms, LEFT)


def alone(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms)
    yield from pull_back(arms)
    yield from around_onto_mat(arms)


def drop_behind(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms)
    yield from drop(arms, RIGHT)
    yield from pull_back(arms)
    yield from clear_of(arms, RIGHT)
    yield from pick_lying(arms, LEFT, "block")
    yield from onto_mat(arms, LEFT)


def around(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from go_around(arms)
    yield from take(arms)
    yield from finish(arms)


def through_back_and_around(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms)
    yield from pull_back(arms)
    yield from go_around(arms)
    yield from take(arms)
    yield from finish(arms)


def around_and_dip(arms: Arms) -> Script:
    """Hand over around the ring, and dip the block into the ring from the far side."""
    yield from pick_bar(arms, BAR)
    yield from go_around(arms)
    yield from take(arms)
    for y in (0.12, -0.015, 0.12):
        shift = ring(arms) + np.array([0.0, y, 0.0]) - arms.sim.position("block")
        yield from move(arms, {LEFT: arms.targets[LEFT].moved(*shift)}, speed=CAREFUL)
    yield from finish(arms)


def throw_through(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    before, beyond = (
        present(BAR, ring(arms) + np.array([0.0, y, 0.03]), RISE) for y in (-0.25, 0.03)
    )
    yield from move(arms, {RIGHT: before})
    for _ in move(arms, {RIGHT: beyond}, speed=0.7, arrive=False):
        if arms.sim.relative_position("block", "gate")[1] > -0.10:
            arms.openings[RIGHT.index] = OPEN
        yield
    yield from pull_back(arms)
    yield from clear_of(arms, RIGHT)
    yield from pick_lying(arms, LEFT, "block")
    yield from onto_mat(arms, LEFT)


def press_on_the_gate(arms: Arms) -> Script:
    """Press against the ring from the left, where a free one would fall onto the block."""
    yield from grip(arms, LEFT)
    x, y, z = ring(arms)
    for beyond in (0.12, -0.15):
        goal = down(x, y + beyond, z + RING_RADIUS)
        yield from move(arms, {LEFT: goal}, speed=CAREFUL)
    yield from pick_bar(arms, BAR)


def let_fall(arms: Arms) -> Script:
    yield from hand_over(arms)
    yield from onto_mat(arms, LEFT, height=0.10)


def let_fall_from_low(arms: Arms) -> Script:
    yield from hand_over(arms)
    x, y, _ = arms.sim.position("mat")
    yield from bring(arms, LEFT, "block", (x, y, 0.15))
    yield from lower(arms, LEFT, "block", MAT_THICKNESS + ABOVE)
    yield from drop(arms, LEFT)


def both_in_the_ring_then_around(arms: Arms) -> Script:
    """Hold the block in the ring with both arms, draw it back, and hand it over around the ring."""
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms, SHORT)
    yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))
    yield from let_go(arms, LEFT)
    yield from pull_back(arms)
    yield from go_around(arms)
    yield from take(arms)
    yield from finish(arms)


def keep(arms: Arms) -> Script:
    """Hold the block in the ring with both arms, draw it back, and put it down with the first."""
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms, SHORT)
    yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))
    yield from let_go(arms, LEFT)
    yield from clear_of(arms, LEFT)
    yield from pull_back(arms)
    yield from around_onto_mat(arms)


def touch_and_let_fall(arms: Arms) -> Script:
    yield from hand_over(arms)
    yield from lower_onto_mat(arms, LEFT)
    yield from move(arms, {LEFT: arms.targets[LEFT].moved(z=0.08)})
    yield from drop(arms, LEFT)


def let_fall_and_pinch(arms: Arms) -> Script:
    yield from let_fall(arms)
    yield from pick_lying(arms, LEFT, "block", lift=0.0)
    yield from drop(arms, LEFT)


def hand_back(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms)
    held_here = arms.targets[RIGHT]
    yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))
    yield from let_go(arms, RIGHT)
    yield from clasp(arms, RIGHT, held_here)
    yield from let_go(arms, LEFT)
    yield from clear_of(arms, LEFT)
    yield from pull_back(arms)
    yield from around_onto_mat(arms)


def dipped(sim: Simulation) -> bool:
    """The left arm has the block in the ring, on the near side of its plane."""
    x, y, z = sim.relative_position("block", "gate")
    return sim.contacts.grasped(LEFT, "block") and y < 0.0 and math.hypot(x, z - RING_HEIGHT) < 0.1


def pressed_on_gate(sim: Simulation) -> bool:
    """The left arm is in contact with the ring or its stand, which are fixed."""
    return sim.contacts.arm(LEFT, "gate")


cheat = partial(Adversary, deed=ends_on_mat, seed=NEAR_MAT)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("one arm goes through the ring, back, and around it", alone, 2, hands=Hands.ONE),
    cheat("the block falls behind the ring, for the other arm", drop_behind, 2, hands=Hands.TURNS),
    cheat("the block flies through the ring", throw_through, 1, hands=Hands.TURNS),
    cheat(
        "the block is handed over around the ring", around, 1, lacks="block has come around gate"
    ),
    cheat("through the ring, back, and handed over around it", through_back_and_around, 2),
    cheat("around, and dipped into the ring from behind", around_and_dip, 1, deed=dipped),
    cheat("the block is handed back", hand_back, 3),
    cheat("the block falls onto the mat", let_fall, 3, lacks="mm above mat, not at most 12 mm"),
    cheat(
        "the block falls from two centimetres above the mat",
        let_fall_from_low,
        3,
        lacks="when left let block go: block is 1",
    ),
    cheat(
        "in both hands in the ring, back, and handed over around", both_in_the_ring_then_around, 1
    ),
    cheat("in both hands in the ring, back, and put down by the first", keep, 1),
    cheat("the block touches the mat, and falls onto it", touch_and_let_fall, 3),
    cheat("the block falls onto the mat, and is pinched there", let_fall_and_pinch, 3),
    # In suite 2 the ring fell onto the block, and what was lifted out of it had come through.
    cheat("an arm presses against the ring", press_on_the_gate, 1, deed=pressed_on_gate),
)
