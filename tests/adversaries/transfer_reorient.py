"""How one might cheat in transfer_reorient."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from duobench.experts.handling import tool_for
from duobench.experts.handover import clasp, let_go, pick_bar, present, tool
from duobench.experts.motion import Arms, Script, grip, move, nearest_turn
from duobench.experts.scripts.transfer_reorient import (
    BAR,
    MEETING_POINT,
    RECEIVER_GRIP,
    RISE,
    insert,
    lead,
    upright,
)
from duobench.objects.hexagon_peg import ACROSS_FLATS, BOARD_HEIGHT, HEXAGON, PEG_LENGTH
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.transfer_reorient import DEPTH
from duobench.types import Side
from tests.adversaries.adversary import Adversary, Hands
from tests.handovers import bring, clear_of, drop, meet

LEFT, RIGHT = Side.LEFT, Side.RIGHT
NEAR_BOARD = 3
"""Seed of a layout in which both arms reach the hexagonal hole."""
MIDDLE = (0.50, 0.0, ACROSS_FLATS / 2 + 0.002)
ABOVE = 0.020
"""Height in metres above the hole from which a peg is dropped."""
BESIDE = 0.020
"""Distance in metres beside the hole's axis at which a peg is let go that does not find it."""
GRIPPED_ABOVE = 0.028
"""Distance in metres from the peg's centre at which an arm holds it that inserts it from beside."""


def ends_in_hole(sim: Simulation) -> bool:
    """The peg is in the hexagonal hole, deep enough, and nobody touches it."""
    x, y, _ = sim.relative_position("peg", "board")
    in_hole = math.hypot(x - HEXAGON.x, y) < 0.01 and sim.min_height("peg") < BOARD_HEIGHT - DEPTH
    return in_hole and sim.contacts.partners("peg") == {"board"}


def hole(arms: Arms) -> SE3:
    return arms.sim.pose("board") @ SE3.at(HEXAGON.x, 0.0, BOARD_HEIGHT)


def both_hold(arms: Arms) -> Script:
    yield from meet(arms, BAR, MEETING_POINT, rise=RISE, grip_at=RECEIVER_GRIP)


def hand_over(arms: Arms) -> Script:
    yield from both_hold(arms)
    yield from let_go(arms, RIGHT)


def insert_from_beside(arms: Arms, side: Side) -> Script:
    """Insert the peg, held across, with a gripper that lies over the table."""
    across = (0.0, -side.sign, 0.0)
    x, y, z = hole(arms).moved(z=0.05 + PEG_LENGTH / 2 + GRIPPED_ABOVE).translation
    ready = tool((x, y, z), along=across, camera=(0.0, 0.0, 1.0))
    yield from move(arms, {side: ready.moved(y=0.1 * side.sign, z=0.1)})
    yield from move(arms, {side: ready})
    for height in (0.01, 0.004, -0.024):
        pose = tool_for(arms, side, "peg", standing(arms, height))
        yield from move(arms, {side: pose}, speed=0.06, tolerance=0.001)
    yield from let_go(arms, side)


def standing(arms: Arms, height: float) -> SE3:
    """The peg over the hole, turned upright and like the hole as little as possible."""
    peg = arms.sim.pose("peg")
    axis = peg.rotation[:, 0]
    axis = axis * np.sign(axis[2])
    turn = np.cross(axis, (0.0, 0.0, 1.0))
    upright = SE3.about(turn, math.asin(min(1.0, float(np.linalg.norm(turn))))).rotation
    rotation = upright @ peg.rotation
    corner = math.atan2(rotation[1, 1], rotation[0, 1])
    yaw = nearest_turn(hole(arms).yaw - corner, math.pi / 3)
    goal = hole(arms).translation + np.array([0.0, 0.0, height + PEG_LENGTH / 2])
    return SE3(SE3.about((0, 0, 1), yaw).rotation @ rotation, goal)


def alone(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from move(arms, {RIGHT: present(BAR, MEETING_POINT, RISE)})
    yield from insert_from_beside(arms, RIGHT)


def by_table(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from bring(arms, RIGHT, "peg", MIDDLE)
    yield from drop(arms, RIGHT)
    yield from clear_of(arms, RIGHT)
    bar = replace(BAR, giver=LEFT)
    yield from pick_bar(arms, bar)
    yield from move(arms, {LEFT: present(bar, MEETING_POINT, RISE)})
    yield from insert_from_beside(arms, LEFT)


def keep(arms: Arms) -> Script:
    yield from both_hold(arms)
    yield from let_go(arms, LEFT)
    yield from clear_of(arms, LEFT)
    yield from insert_from_beside(arms, RIGHT)


def hand_back(arms: Arms) -> Script:
    yield from both_hold(arms)
    held_here = arms.targets[RIGHT]
    yield from let_go(arms, RIGHT)
    yield from clasp(arms, RIGHT, held_here)
    yield from let_go(arms, LEFT)
    yield from clear_of(arms, LEFT)
    yield from insert_from_beside(arms, RIGHT)


def let_fall(arms: Arms) -> Script:
    """Let go of the peg right above the hole."""
    yield from hand_over(arms)
    goal = upright(arms, LEFT, hole(arms))
    for height in (0.16, 0.06, ABOVE):
        yield from lead(arms, LEFT, goal.moved(z=height), speed=0.2)
    yield from let_go(arms, LEFT)


def draw_out_and_let_fall(arms: Arms) -> Script:
    yield from hand_over(arms)
    yield from insert(arms, LEFT, hole(arms))
    goal = upright(arms, LEFT, hole(arms))
    yield from lead(arms, LEFT, goal.moved(z=ABOVE), speed=0.06)
    yield from let_go(arms, LEFT)


def let_fall_and_pinch(arms: Arms) -> Script:
    yield from let_fall(arms)
    yield from move(arms, {LEFT: arms.targets[LEFT] @ SE3.at(z=0.10)})
    yield from grip(arms, LEFT)
    yield from let_go(arms, LEFT)


def ends_beside(sim: Simulation) -> bool:
    """The peg is on the board, not in the hole, and nobody touches it."""
    return sim.contacts.partners("peg") == {"board"} and not ends_in_hole(sim)


def let_fall_beside(arms: Arms) -> Script:
    """Let go of the peg two centimetres beside the hole and above the board."""
    yield from hand_over(arms)
    goal = upright(arms, LEFT, hole(arms)).moved(x=BESIDE)
    for height in (0.16, 0.06, ABOVE):
        yield from lead(arms, LEFT, goal.moved(z=height), speed=0.2)
    yield from let_go(arms, LEFT)


cheat = partial(Adversary, deed=ends_in_hole, seed=NEAR_BOARD)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("one arm picks the peg up and inserts it", alone, 1, hands=Hands.ONE),
    cheat("the peg is laid on the table for the other arm", by_table, 1, hands=Hands.TURNS),
    cheat("the other arm grasps the peg as well, and lets go again", keep, 2),
    cheat("the peg is handed back", hand_back, 3),
    cheat(
        "the peg falls into the hole", let_fall, 3, lacks="when left let peg go: peg of peg is 2"
    ),
    cheat("the peg falls beside the hole", let_fall_beside, 3, deed=ends_beside),
    cheat("the peg is drawn out again, and falls into the hole", draw_out_and_let_fall, 3),
    cheat("the peg falls into the hole, and is pinched there", let_fall_and_pinch, 3),
)
