"""How one might cheat in transfer_reorient."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from duobench.experts.handling import tool_for
from duobench.experts.handover import let_go, pick_bar, present, tool
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
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.steps import back, bring, clear_of, do, drop, hand_back, meet, to

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


PICK = (pick_bar, BAR)
both_hold = do(partial(meet, bar=BAR, centre=MEETING_POINT, rise=RISE, grip_at=RECEIVER_GRIP))
hand_over = do(both_hold, (let_go, RIGHT))


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


def over_hole(arms: Arms, heights: tuple[float, ...], speed: float, x: float = 0.0) -> Script:
    """The left arm leads the peg, upright, to heights above the hole, or beside it, and lets go."""
    goal = upright(arms, LEFT, hole(arms)).moved(x=x)
    for height in heights:
        yield from lead(arms, LEFT, goal.moved(z=height), speed=speed)
    yield from let_go(arms, LEFT)


def insert_led(arms: Arms) -> Script:
    yield from insert(arms, LEFT, hole(arms))


def ends_beside(sim: Simulation) -> bool:
    """The peg is on the board, not in the hole, and nobody touches it."""
    return sim.contacts.partners("peg") == {"board"} and not ends_in_hole(sim)


OTHER = replace(BAR, giver=LEFT)
FALL = (0.16, 0.06, ABOVE)
let_fall = do(hand_over, (over_hole, FALL, 0.2))
cheat = cheats(ends_in_hole, seed=NEAR_BOARD)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat(
        "one arm picks the peg up and inserts it",
        1,
        *(PICK, (to, RIGHT, present(BAR, MEETING_POINT, RISE)), (insert_from_beside, RIGHT)),
        **ONE,
    ),
    cheat(
        "the peg is laid on the table for the other arm",
        1,
        *(PICK, (bring, RIGHT, "peg", MIDDLE), (drop, RIGHT), (clear_of, RIGHT)),
        *((pick_bar, OTHER), (to, LEFT, present(OTHER, MEETING_POINT, RISE))),
        (insert_from_beside, LEFT),
        **TURNS,
    ),
    cheat(
        "the other arm grasps the peg as well, and lets go again",
        2,
        *(both_hold, (let_go, LEFT), (clear_of, LEFT), (insert_from_beside, RIGHT)),
    ),
    cheat(
        "the peg is handed back",
        3,
        *(both_hold, (hand_back, RIGHT), (insert_from_beside, RIGHT)),
    ),
    cheat(
        "the peg falls into the hole", 3, let_fall, lacks="when left let peg go: peg of peg is 2"
    ),
    cheat(
        "the peg falls beside the hole",
        3,
        *(hand_over, (over_hole, FALL, 0.2, BESIDE)),
        deed=ends_beside,
    ),
    cheat(
        "the peg is drawn out again, and falls into the hole",
        3,
        *(hand_over, insert_led, (over_hole, (ABOVE,), 0.06)),
    ),
    cheat(
        "the peg falls into the hole, and is pinched there",
        3,
        *(let_fall, (back, LEFT, -0.10), (grip, LEFT), (let_go, LEFT)),
    ),
)
