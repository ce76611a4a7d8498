"""Ways to hand a block over and put it into a bowl, and to seem to."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Array, Side
from duobench.tasks.experts.handling import tool_for
from duobench.tasks.experts.handover import Bar, hanging, let_go, pick_bar, present, receive_pose
from duobench.tasks.experts.motion import CAREFUL, OPEN, Arms, Script, down, grip
from duobench.tasks.experts.scripts.transfer_cube import (
    BAR,
    MEETING_POINT,
    RECEIVER_GRIP,
    RISE,
    SLANT,
)
from duobench.world.objects.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.world.objects.bowl import FLOOR, RADIUS, RIM_HEIGHT, WALL
from duobench.world.sim.simulation import Simulation
from tests.steps import Act, bring, by, clear_of, do, drop, hand_back, lower, meet, pick_lying, to
from tests.ways import handing
from tests.ways.way import ONE, TURNS, Way, cheats, random_tempo, ways_to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
MIDDLE = (0.48, 0.0, CUBE_EDGE / 2 + 0.002)
HALF_OPEN = 0.25
"""Opening at which both fingers meet the end of the block."""
PAD_REACH = 0.023
"""How far pads reach beyond the tool point, in metres."""
IN_BOWL = np.array([0.0, 0.0, 0.045])


def done(sim: Simulation) -> bool:
    """The block rests in the bowl, below its rim, and nobody touches it."""
    x, y, _ = sim.relative_position("cube", "bowl")
    return (
        math.hypot(x, y) < RADIUS - WALL
        and sim.min_height("cube") < RIM_HEIGHT / 2
        and sim.contacts.partners("cube") == {"bowl"}
        and "table" in sim.contacts.partners("bowl")
        and sim.rotation("bowl")[2, 2] > math.cos(math.radians(10))
        and handing.at_rest(sim.speed("cube"))
    )


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
    yield from to(arms, RIGHT, present(BAR, MEETING_POINT, RISE))
    yield from grip(arms, LEFT, opening=HALF_OPEN)
    end = receive_pose(arms, BAR, LONG_BLOCK / 2 + PAD_REACH, 0.0)
    for way in (-0.08, 0.006, -0.08):
        yield from to(arms, LEFT, end @ SE3.at(z=way), speed=CAREFUL)


def tip_over_the_rim(arms: Arms) -> Script:
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


AGAIN = do((pick_lying, LEFT, "cube"), into_bowl(LEFT))
cheat = cheats(done)
ADVERSARIES: dict[str, Way] = {
    "one arm picks the block up and puts it into the bowl": cheat(1, PICK, into_bowl(RIGHT), **ONE),
    "the block is laid on the table for the other arm": cheat(
        1, PICK, by_table(RIGHT), into_bowl(LEFT), **TURNS
    ),
    "the other arm grasps the block as well, and lets go again": cheat(
        2, both_hold, (let_go, LEFT), (clear_of, LEFT), into_bowl(RIGHT)
    ),
    "the block is handed back": cheat(3, both_hold, (hand_back, RIGHT), into_bowl(RIGHT)),
    "both arms hold the block and drop it, and the other one picks it up": cheat(
        2, both_hold, (drop, *SIDES), (clear_of, RIGHT), AGAIN
    ),
    "the block is given back by way of the table": cheat(
        3, hand_over, (clear_of, RIGHT), by_table(LEFT), into_bowl(RIGHT)
    ),
    "the block is handed over once, and once more by way of the table": cheat(
        3, hand_over, (clear_of, RIGHT), by_table(LEFT), (drop, RIGHT), (clear_of, RIGHT), AGAIN
    ),
    "the block is thrown into the bowl": cheat(3, hand_over, throw),
    **{
        f"the block is dropped into the bowl from {1000 * height:.0f} mm above its rim": cheat(
            3,
            hand_over,
            (drop_from_above_the_rim, height),
            lacks="when left let cube go: cube is ",
        )
        for height in (0.15, 0.25)
    },
    "the other arm presses half-open fingers on the block's end": cheat(
        1, PICK, press_on_its_end, (clear_of, LEFT), into_bowl(RIGHT)
    ),
    "the block is tipped over the rim into the bowl": cheat(3, hand_over, tip_over_the_rim),
}

# --- sincere ways ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan(handing.Meeting):
    """How the block goes into the bowl; the defaults are the expert's way."""

    bar: Bar = BAR
    centre: tuple[float, float, float] = tuple(MEETING_POINT.tolist())
    rise: float = RISE
    grip_at: float = RECEIVER_GRIP
    slant: float = SLANT
    lean: float = math.radians(40)
    """Angle in radians from upright at which the block is let go."""
    height: float = 0.0
    """How far its lowest point is above the bowl's floor then, in metres."""
    x: float = 0.0
    """Where its lower end is in the bowl, in metres from the middle."""
    y: float = -0.02


def hand_over_and_put(arms: Arms, plan: Plan) -> Script:
    yield from handing.hand_over(arms, plan)
    giver, side = plan.bar.giver, plan.bar.giver.other
    yield from clear_of(arms, giver)
    place = np.array([plan.x, plan.y * side.sign, FLOOR + plan.height])
    spot, low = arms.sim.position("bowl") + place, max(RIM_HEIGHT, FLOOR + plan.height)
    yield from handing.put_down(arms, side, BAR.body, plan.lean, spot, low=low)


way = ways_to(hand_over_and_put, done, Plan())
SINCERE: dict[str, Way] = {
    "received deep in the fingers": way(bar=replace(BAR, grip=0.036), grip_at=0.012),
    "received at the fingertips": way(grip_at=0.044),
    "received from above, laid down flat": way(
        slant=math.radians(45), grip_at=0.032, lean=math.radians(88), y=-0.05
    ),
    "put in standing": way(lean=0.0, y=0.0),
    "let go at the rim's height": way(lean=0.5, height=RIM_HEIGHT - FLOOR),
    **{
        f"let go {1000 * high:.0f} mm above the rim": way(
            lean=0.3, height=RIM_HEIGHT - FLOOR + high, y=0.0
        )
        for high in (0.013, 0.028, 0.050)
    },
    "let go eight millimetres above the floor": way(lean=0.3, height=0.008),
    "pressed three millimetres into the floor": way(height=-0.003),
    "picked up by its middle": way(bar=replace(BAR, grip=0.010)),
    "picked up by its end": way(bar=replace(BAR, grip=0.036)),
    "picked up by the fingertips": way(bar=replace(BAR, height=0.034)),
    "picked up deep": way(bar=replace(BAR, height=0.018)),
    "picked up by a tilted hand": way(bar=replace(BAR, tilt=0.3)),
    "handed over upright": way(rise=math.radians(60)),
    "half the speed": way(slowness=2),
    "trembling": way(tremble=0.01),
    "the left arm gives": way(bar=replace(BAR, giver=LEFT)),
}


def sample(rng: np.random.Generator) -> Way:
    slant = math.radians(rng.uniform(0, 45))
    return way(
        **handing.random_grasps(rng, BAR, 0.044, left=0.2),
        centre=(rng.uniform(0.45, 0.55), rng.uniform(-0.05, 0.05), rng.uniform(0.28, 0.38)),
        rise=math.radians(rng.uniform(10, 60)),
        slant=slant,
        lean=slant + rng.uniform(0.0, 0.7),
        height=rng.uniform(-0.003, RIM_HEIGHT - FLOOR + 0.05),
        x=rng.uniform(-0.03, 0.03),
        y=rng.uniform(-0.04, 0.01),
        **random_tempo(rng, **handing.RARELY),
    )
