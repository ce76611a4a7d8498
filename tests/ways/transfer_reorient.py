"""Ways to hand a peg over and insert it upright, and to seem to."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handling import tool_for
from duobench.tasks.experts.handover import Bar, let_go, pick_bar, present, tool
from duobench.tasks.experts.motion import Arms, Script, grip, move, nearest_turn, release, wait
from duobench.tasks.experts.scripts.transfer_reorient import (
    BAR,
    MEETING_POINT,
    RECEIVER_GRIP,
    RISE,
    insert,
    lead,
    upright,
)
from duobench.world.objects.hexagon_peg import ACROSS_FLATS, BOARD_HEIGHT, HEXAGON, PEG_LENGTH
from duobench.world.sim.simulation import Simulation
from tests.steps import back, bring, clear_of, do, drop, hand_back, meet, to
from tests.ways import handing
from tests.ways.way import ONE, TURNS, Way, cheats, random_tempo, ways_to

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
DEEP_ENOUGH = 0.015
"""How deep the peg is in the hole at least, in metres [task definitions]."""


def done(sim: Simulation) -> bool:
    """The peg stands in the hexagonal hole, deep enough, and nobody touches it."""
    x, y, _ = sim.relative_position("peg", "board")
    return (
        math.hypot(x - HEXAGON.x, y) < 0.005
        and abs(sim.rotation("peg")[2, 0]) > math.cos(math.radians(8))
        and sim.min_height("peg") < BOARD_HEIGHT - DEEP_ENOUGH
        and sim.contacts.partners("peg") == {"board"}
        and handing.at_rest(sim.speed("peg"))
    )


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
    """The peg is on the board, in no hole, and nobody touches it."""
    above = sim.min_height("peg") > BOARD_HEIGHT - DEEP_ENOUGH
    return above and sim.contacts.partners("peg") == {"board"}


OTHER = replace(BAR, giver=LEFT)
FALL = (0.16, 0.06, ABOVE)
let_fall = do(hand_over, (over_hole, FALL, 0.2))
cheat = cheats(done, seed=NEAR_BOARD)
ADVERSARIES: dict[str, Way] = {
    "one arm picks the peg up and inserts it": cheat(
        1,
        PICK,
        (to, RIGHT, present(BAR, MEETING_POINT, RISE)),
        (insert_from_beside, RIGHT),
        **ONE,
    ),
    "the peg is laid on the table for the other arm": cheat(
        1,
        PICK,
        (bring, RIGHT, "peg", MIDDLE),
        (drop, RIGHT),
        (clear_of, RIGHT),
        (pick_bar, OTHER),
        (to, LEFT, present(OTHER, MEETING_POINT, RISE)),
        (insert_from_beside, LEFT),
        **TURNS,
    ),
    "the other arm grasps the peg as well, and lets go again": cheat(
        2, both_hold, (let_go, LEFT), (clear_of, LEFT), (insert_from_beside, RIGHT)
    ),
    "the peg is handed back": cheat(3, both_hold, (hand_back, RIGHT), (insert_from_beside, RIGHT)),
    "the peg falls into the hole": cheat(
        3, let_fall, lacks="when left let peg go: peg of peg is 2"
    ),
    "the peg falls beside the hole": cheat(
        3, hand_over, (over_hole, FALL, 0.2, BESIDE), deed=ends_beside
    ),
    "the peg is drawn out again, and falls into the hole": cheat(
        3, hand_over, insert_led, (over_hole, (ABOVE,), 0.06)
    ),
    "the peg falls into the hole, and is pinched there": cheat(
        3, let_fall, (back, LEFT, -0.10), (grip, LEFT), (let_go, LEFT)
    ),
}

# --- sincere ways ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan(handing.Meeting):
    """How the peg goes into the hole; the defaults are the expert's way."""

    bar: Bar = BAR
    centre: tuple[float, float, float] = tuple(MEETING_POINT.tolist())
    rise: float = RISE
    grip_at: float = RECEIVER_GRIP
    depth: float = 0.024
    """How deep its tip is led into the hole before it is let go, in metres; above it below 0."""
    aside: float = 0.0
    """How far beside the hole's axis the tip is then, in metres."""
    retreat: bool = True
    """Whether the hand is drawn back, or only opened."""


def hand_over_and_insert(arms: Arms, plan: Plan) -> Script:
    yield from handing.hand_over(arms, plan)
    giver, side = plan.bar.giver, plan.bar.giver.other
    yield from clear_of(arms, giver)
    goal = upright(arms, side, hole(arms)).moved(x=plan.aside)
    for height, speed in ((0.16, 0.4), (0.06, 0.4), (0.010, 0.12), (0.004, 0.12)):
        if height >= -plan.depth:
            yield from lead(arms, side, goal.moved(z=height), speed=speed)
    yield from lead(arms, side, goal.moved(z=-plan.depth), speed=0.06)
    low = BOARD_HEIGHT + max(0.0, -plan.depth)
    handing.check(arms.sim.min_height(BAR.body) < low + handing.SEEN)
    if plan.retreat:
        yield from let_go(arms, side)
    else:
        yield from release(arms, side)
        yield from wait(10)


way = ways_to(hand_over_and_insert, done, Plan())
SINCERE: dict[str, Way] = {
    "received deep in the fingers": way(bar=replace(BAR, grip=0.036), grip_at=0.014),
    "received at the fingertips": way(grip_at=0.042),
    "let go with the tip in the hole": way(depth=0.006),
    **{f"let go {high} mm above the hole": way(depth=-high / 1000) for high in (1, 3, 6, 9)},
    "let go 3 mm above the hole and 2 mm beside it": way(depth=-0.003, aside=0.002),
    "let go half-way": way(depth=0.012),
    "pressed onto the hole's floor": way(depth=0.029),
    "the hand only opens": way(retreat=False),
    "picked up by its middle": way(bar=replace(BAR, grip=0.016)),
    "picked up by its end": way(bar=replace(BAR, grip=0.038)),
    "picked up by the fingertips": way(bar=replace(BAR, height=0.033)),
    "picked up deep": way(bar=replace(BAR, height=0.019)),
    "picked up by a tilted hand": way(bar=replace(BAR, tilt=0.2)),
    "handed over nearly level": way(rise=math.radians(30)),
    "half the speed": way(slowness=2),
    "trembling": way(tremble=0.01),
    "the left arm gives": way(bar=OTHER),
}


def sample(rng: np.random.Generator) -> Way:
    return way(
        **handing.random_grasps(rng, BAR, 0.042, left=0.2),
        centre=(rng.uniform(0.47, 0.53), rng.uniform(-0.03, 0.03), rng.uniform(0.36, 0.40)),
        rise=math.radians(rng.uniform(30, 65)),
        slant=math.radians(rng.uniform(0, 10)),
        depth=rng.uniform(-0.008, 0.028),
        retreat=bool(rng.random() < 0.7),
        **random_tempo(rng, **handing.RARELY),
    )
