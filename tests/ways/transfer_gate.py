"""Ways to hand a block over through a ring and put it down, and to seem to."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handover import Bar, clasp, let_go, pick_bar, present, receive_pose
from duobench.tasks.experts.motion import CAREFUL, OPEN, Arms, Script, down, grip
from duobench.tasks.experts.scripts.transfer_gate import (
    BAR,
    BEYOND,
    LEAN,
    RECEIVER_GRIP,
    RISE,
    leave,
    lower_onto_mat,
    reach_through,
    ring,
)
from duobench.world.objects.blocks import CUBE_EDGE
from duobench.world.objects.gate import MAT_EDGE, MAT_THICKNESS, RING_HEIGHT, RING_RADIUS
from duobench.world.sim.simulation import Simulation
from tests.steps import bring, by, clear_of, do, drop, lower, pick_lying, to
from tests.ways import handing
from tests.ways.way import ONE, TURNS, Way, cheats, random_tempo, ways_to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
ABOVE = 0.020
"""Height in metres above the mat from which the block is dropped."""
SHORT = -0.020
"""Where the block's centre is along the ring's axis, in metres, when it only reaches in."""
ASIDE = 0.26
"""Distance in metres from the ring's axis at which an arm leads the block around the ring."""
BEFORE = -0.14
"""Where the block's centre waits before the ring, along its axis, in metres."""


def done(sim: Simulation) -> bool:
    """The block rests on the mat, and nobody touches it."""
    x, y, _ = sim.relative_position("block", "mat")
    return (
        max(abs(x), abs(y)) < MAT_EDGE / 2
        and sim.contacts.partners("block") == {"mat"}
        and handing.at_rest(sim.speed("block"))
    )


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
    for y in (-0.16, 0.03):
        yield from to(arms, RIGHT, presented(arms, ASIDE, y))


def around_onto_mat(arms: Arms) -> Script:
    x, y, z = ring(arms)
    yield from to(arms, RIGHT, down(x, y - 0.20, z))
    yield from to(arms, RIGHT, down(x + ASIDE, y - 0.16, z))
    yield from onto_mat(arms, RIGHT)


def receive(arms: Arms) -> Script:
    yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))


PICK = (pick_bar, BAR)
take = do(receive, (let_go, RIGHT), (leave, RIGHT))
hand_over = do(PICK, reach_through, take)
finish = do((lower_onto_mat, LEFT), (drop, LEFT))
pick_again = do(pull_back, (clear_of, RIGHT), (pick_lying, LEFT, "block"), (onto_mat, LEFT))
hold_by_both_in_the_ring = do(PICK, (reach_through, SHORT), receive, (let_go, LEFT))
let_fall = do(hand_over, (onto_mat, LEFT, {"height": 0.10}))


def dip(arms: Arms) -> Script:
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


cheat = cheats(done)
ADVERSARIES: dict[str, Way] = {
    "one arm goes through the ring, back, and around it": cheat(
        2, PICK, reach_through, pull_back, around_onto_mat, **ONE
    ),
    "the block falls behind the ring, for the other arm": cheat(
        2, PICK, reach_through, (drop, RIGHT), pick_again, **TURNS
    ),
    "the block flies through the ring": cheat(1, PICK, throw_through, pick_again, **TURNS),
    "the block is handed over around the ring": cheat(
        1, PICK, go_around, take, finish, lacks="block has come around gate"
    ),
    "through the ring, back, and handed over around it": cheat(
        2, PICK, reach_through, pull_back, go_around, take, finish
    ),
    "around, and dipped into the ring from behind": cheat(
        1, PICK, go_around, take, dip, finish, deed=dipped
    ),
    "the block is handed back": cheat(
        3, PICK, reach_through, hand_back, (clear_of, LEFT), pull_back, around_onto_mat
    ),
    "the block falls onto the mat": cheat(3, let_fall, lacks="mm above mat, not at most 12 mm"),
    "the block falls from two centimetres above the mat": cheat(
        3, hand_over, let_fall_from_low, lacks="when left let block go: block is 1"
    ),
    "in both hands in the ring, back, and handed over around": cheat(
        1, hold_by_both_in_the_ring, pull_back, go_around, take, finish
    ),
    "in both hands in the ring, back, and put down by the first": cheat(
        1, hold_by_both_in_the_ring, (clear_of, LEFT), pull_back, around_onto_mat
    ),
    "the block touches the mat, and falls onto it": cheat(
        3, hand_over, (lower_onto_mat, LEFT), (by, LEFT, {"z": 0.08}), (drop, LEFT)
    ),
    "the block falls onto the mat, and is pinched there": cheat(
        3, let_fall, (pick_lying, LEFT, "block", {"lift": 0.0}), (drop, LEFT)
    ),
    # In suite 2 the ring fell onto the block, and what was lifted out of it had come through.
    "an arm presses against the ring": cheat(1, press_on_the_gate, PICK, deed=pressed_on_gate),
}

# --- sincere ways ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan(handing.Meeting):
    """How the block goes through the ring and onto the mat; the defaults are the expert's way."""

    bar: Bar = BAR
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Follows from the place of the ring."""
    rise: float = RISE
    grip_at: float = RECEIVER_GRIP
    lean_away: float = LEAN
    beyond: float = BEYOND
    """Where the block's centre is handed over, along the ring's axis, in metres."""
    aside: float = 0.0
    """And how far beside the axis."""
    lean: float = 0.0
    """Angle in radians from upright at which it is let go."""
    height: float = 0.0
    """How far its lowest point is above the mat then, in metres."""
    x: float = 0.0
    """Where its lower end is on the mat, in metres from the middle."""
    y: float = 0.0


def hand_over_and_put(arms: Arms, plan: Plan) -> Script:
    x, y, z = ring(arms)
    centre = (x + plan.aside, y + plan.beyond, z)
    yield from handing.hand_over(arms, replace(plan, centre=centre, before=plan.beyond - BEFORE))
    giver, side = plan.bar.giver, plan.bar.giver.other
    yield from leave(arms, giver)
    yield from by(arms, side, x=0.06, y=0.12, z=0.03, arrive=False)
    place = np.array([plan.x, plan.y, MAT_THICKNESS / 2 + plan.height])
    spot, low = arms.sim.position("mat") + place, MAT_THICKNESS + max(0.0, plan.height)
    yield from handing.put_down(arms, side, BAR.body, plan.lean, spot, low=low)


way = ways_to(hand_over_and_put, done, Plan())
SINCERE: dict[str, Way] = {
    "handed over in the ring, before the plane": way(beyond=-0.020),
    "handed over in the ring, at the plane": way(beyond=-0.003),
    "handed over in the ring, just behind the plane": way(beyond=0.004),
    "received deep in the fingers": way(bar=replace(BAR, grip=0.036), grip_at=0.012),
    "received at the fingertips": way(grip_at=0.042),
    "let go a millimetre above the mat": way(height=0.001),
    "let go eight millimetres above the mat": way(height=0.008),
    "pressed three millimetres into the mat": way(height=-0.003),
    "laid down flat": way(slant=math.radians(50), lean=math.radians(89), grip_at=0.034, y=-0.03),
    # In the layouts before it the closing hand tears the block out of the other one.
    "picked up by its middle": way(bar=replace(BAR, grip=0.018), seed=2),
    "picked up deep": way(bar=replace(BAR, height=0.018)),
    "picked up by the fingertips": way(bar=replace(BAR, height=0.034)),
    "picked up by a tilted hand": way(bar=replace(BAR, tilt=0.3)),
    "off the axis of the ring": way(aside=0.02),
    "half the speed": way(slowness=2),
    "trembling": way(tremble=0.01),
}


def sample(rng: np.random.Generator) -> Way:
    flat = rng.random() < 0.25
    return way(
        **handing.random_grasps(rng, BAR, 0.042),
        slant=math.radians(rng.uniform(40, 50) if flat else rng.uniform(0, 15)),
        rise=math.radians(rng.uniform(40, 50)),
        beyond=rng.uniform(-0.030, 0.030),
        aside=rng.uniform(-0.015, 0.015),
        lean=math.radians(rng.uniform(86, 90) if flat else rng.uniform(0, 5)),
        height=rng.uniform(-0.003, 0.009),
        x=rng.uniform(-0.05, 0.05),
        y=rng.uniform(-0.05, 0.02),
        **random_tempo(rng, **handing.RARELY),
    )
