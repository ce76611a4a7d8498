"""How one might cheat in transfer_gate."""

from __future__ import annotations

import math

import numpy as np

from duobench.experts.handover import clasp, let_go, pick_bar, present, receive_pose
from duobench.experts.motion import CAREFUL, OPEN, Arms, Script, down, grip
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
from duobench.spatial import SE3
from duobench.types import Side
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.steps import bring, by, clear_of, do, drop, lower, pick_lying, to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
ABOVE = 0.020
"""Height in metres above the mat from which the block is dropped."""
SHORT = -0.020
"""Where the block's centre is along the ring's axis, in metres, when it only reaches in."""
ASIDE = 0.26
"""Distance in metres from the ring's axis at which an arm leads the block around the ring."""


def ends_on_mat(sim: Simulation) -> bool:
    """The block lies on the mat, and nobody touches it."""
    return sim.contacts.partners("block") == {"mat"}


def presented(arms: Arms, x: float, y: float, z: float = 0.0) -> SE3:
    """Tool pose of the giver with the block beside, along and above the ring's middle."""
    return present(BAR, ring(arms) + np.array([x, y, z]), RISE)


def onto_mat(arms: Arms, side: Side, *, height: float = 0.002) -> Script:
    """Put the block down on the mat, or let go of it from a height above."""
    x, y, _ = arms.sim.position("mat")
    yield from bring(arms, side, "block", (x, y, MAT_THICKNESS + CUBE_EDGE / 2 + height))
    yield from drop(arms, side)


def pull_back(arms: Arms) -> Script:
    yield from to(arms, RIGHT, presented(arms, 0.0, -0.16), speed=0.3)


def go_around(arms: Arms) -> Script:
    """Lead the block in the right arm around the ring to its far side."""
    for y in (-0.16, 0.03):
        yield from to(arms, RIGHT, presented(arms, ASIDE, y))


def around_onto_mat(arms: Arms) -> Script:
    """Carry the block in the right arm around the ring and put it down on the mat."""
    x, y, z = ring(arms)
    yield from to(arms, RIGHT, down(x, y - 0.20, z))
    yield from to(arms, RIGHT, down(x + ASIDE, y - 0.16, z))
    yield from onto_mat(arms, RIGHT)


def receive(arms: Arms) -> Script:
    """The left arm clasps where the right one presents the block."""
    yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))


PICK = (pick_bar, BAR)
take = do(receive, (let_go, RIGHT), (leave, RIGHT))
hand_over = do(PICK, reach_through, take)
finish = do((lower_onto_mat, LEFT), (drop, LEFT))
pick_again = do(pull_back, (clear_of, RIGHT), (pick_lying, LEFT, "block"), (onto_mat, LEFT))
hold_by_both_in_the_ring = do(PICK, (reach_through, SHORT), receive, (let_go, LEFT))
let_fall = do(hand_over, (onto_mat, LEFT, {"height": 0.10}))


def dip(arms: Arms) -> Script:
    """Dip the block into the ring from the far side."""
    for y in (0.12, -0.015, 0.12):
        shift = ring(arms) + np.array([0.0, y, 0.0]) - arms.sim.position("block")
        yield from by(arms, LEFT, *shift, speed=CAREFUL)


def throw_through(arms: Arms) -> Script:
    before, beyond = (presented(arms, 0.0, y, 0.03) for y in (-0.25, 0.03))
    yield from to(arms, RIGHT, before)
    for _ in to(arms, RIGHT, beyond, speed=0.7, arrive=False):
        if arms.sim.relative_position("block", "gate")[1] > -0.10:
            arms.openings[RIGHT.index] = OPEN
        yield


def press_on_the_gate(arms: Arms) -> Script:
    """Press against the ring from the left, where a free one would fall onto the block."""
    yield from grip(arms, LEFT)
    x, y, z = ring(arms)
    for beyond in (0.12, -0.15):
        yield from to(arms, LEFT, down(x, y + beyond, z + RING_RADIUS), speed=CAREFUL)


def let_fall_from_low(arms: Arms) -> Script:
    x, y, _ = arms.sim.position("mat")
    yield from bring(arms, LEFT, "block", (x, y, 0.15))
    yield from lower(arms, LEFT, "block", MAT_THICKNESS + ABOVE)
    yield from drop(arms, LEFT)


def hand_back(arms: Arms) -> Script:
    held_here = arms.targets[RIGHT]
    yield from receive(arms)
    yield from let_go(arms, RIGHT)
    yield from clasp(arms, RIGHT, held_here)
    yield from let_go(arms, LEFT)


def dipped(sim: Simulation) -> bool:
    """The left arm has the block in the ring, on the near side of its plane."""
    x, y, z = sim.relative_position("block", "gate")
    return sim.contacts.grasped(LEFT, "block") and y < 0.0 and math.hypot(x, z - RING_HEIGHT) < 0.1


def pressed_on_gate(sim: Simulation) -> bool:
    """The left arm is in contact with the ring or its stand, which are fixed."""
    return sim.contacts.arm(LEFT, "gate")


cheat = cheats(ends_on_mat)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat(
        "one arm goes through the ring, back, and around it",
        2,
        *(PICK, reach_through, pull_back, around_onto_mat),
        **ONE,
    ),
    cheat(
        "the block falls behind the ring, for the other arm",
        2,
        *(PICK, reach_through, (drop, RIGHT), pick_again),
        **TURNS,
    ),
    cheat("the block flies through the ring", 1, PICK, throw_through, pick_again, **TURNS),
    cheat(
        "the block is handed over around the ring",
        1,
        *(PICK, go_around, take, finish),
        lacks="block has come around gate",
    ),
    cheat(
        "through the ring, back, and handed over around it",
        2,
        *(PICK, reach_through, pull_back, go_around, take, finish),
    ),
    cheat(
        "around, and dipped into the ring from behind",
        1,
        *(PICK, go_around, take, dip, finish),
        deed=dipped,
    ),
    cheat(
        "the block is handed back",
        3,
        *(PICK, reach_through, hand_back, (clear_of, LEFT), pull_back, around_onto_mat),
    ),
    cheat("the block falls onto the mat", 3, let_fall, lacks="mm above mat, not at most 12 mm"),
    cheat(
        "the block falls from two centimetres above the mat",
        3,
        *(hand_over, let_fall_from_low),
        lacks="when left let block go: block is 1",
    ),
    cheat(
        "in both hands in the ring, back, and handed over around",
        1,
        *(hold_by_both_in_the_ring, pull_back, go_around, take, finish),
    ),
    cheat(
        "in both hands in the ring, back, and put down by the first",
        1,
        *(hold_by_both_in_the_ring, (clear_of, LEFT), pull_back, around_onto_mat),
    ),
    cheat(
        "the block touches the mat, and falls onto it",
        3,
        *(hand_over, (lower_onto_mat, LEFT), (by, LEFT, {"z": 0.08}), (drop, LEFT)),
    ),
    cheat(
        "the block falls onto the mat, and is pinched there",
        3,
        *(let_fall, (pick_lying, LEFT, "block", {"lift": 0.0}), (drop, LEFT)),
    ),
    # In suite 2 the ring fell onto the block, and what was lifted out of it had come through.
    cheat("an arm presses against the ring", 1, press_on_the_gate, PICK, deed=pressed_on_gate),
)
