"""Sincere ways of transfer_cube."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from duobench.experts.motion import Arms, Script
from duobench.experts.scripts.transfer_cube import BAR, MEETING_POINT, RECEIVER_GRIP, RISE, SLANT
from duobench.objects.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.objects.bowl import FLOOR, RADIUS, RIM_HEIGHT, WALL
from duobench.sim.simulation import Simulation
from duobench.types import Side
from tests.sincere import handing
from tests.sincere.sincere import Way, ways_to
from tests.steps import clear_of

EXPERT = handing.Meeting(
    bar=BAR,
    centre=tuple(MEETING_POINT.tolist()),
    rise=RISE,
    grip_at=RECEIVER_GRIP,
    slant=SLANT,
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """How the block goes into the bowl."""

    meeting: handing.Meeting = EXPERT
    lean: float = math.radians(40)
    """Angle in radians from upright at which the block is let go."""
    height: float = 0.0
    """How far its lowest point is above the bowl's floor then, in metres."""
    x: float = 0.0
    """Where its lower end is in the bowl, in metres from the middle."""
    y: float = -0.02

    def script(self, arms: Arms) -> Script:
        yield from handing.hand_over(arms, self.meeting)
        giver, side = self.meeting.bar.giver, self.meeting.bar.giver.other
        yield from clear_of(arms, giver)
        pose = handing.leaning(arms, side, BAR.body, self.lean)
        spot = arms.sim.position("bowl") + np.array(
            [self.x, self.y * side.sign, FLOOR + self.height]
        )
        shift = spot - handing.low_end(pose, LONG_BLOCK, CUBE_EDGE)
        yield from handing.put_down(
            arms, side, BAR.body, pose.moved(*shift), low=max(RIM_HEIGHT, FLOOR + self.height)
        )


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


way = ways_to(lambda arms, plan: plan.script(arms), done, Plan())


FLAT = replace(EXPERT, slant=math.radians(45), grip_at=0.032)
DEEP = replace(EXPERT, grip_at=0.012)
WAYS: tuple[Way, ...] = (
    way("received deep in the fingers", Plan(meeting=handing.held(DEEP, grip=0.036))),
    way("received at the fingertips", Plan(meeting=replace(EXPERT, grip_at=0.044))),
    way("received from above, laid down flat", Plan(meeting=FLAT, lean=math.radians(88), y=-0.05)),
    way("put in standing", Plan(lean=0.0, y=0.0)),
    way("let go at the rim's height", Plan(lean=0.5, height=RIM_HEIGHT - FLOOR)),
    *(
        way(
            f"let go {1000 * high:.0f} mm above the rim",
            Plan(lean=0.3, height=RIM_HEIGHT - FLOOR + high, y=0.0),
        )
        for high in (0.013, 0.028, 0.050)
    ),
    way("let go eight millimetres above the floor", Plan(lean=0.3, height=0.008)),
    way("pressed three millimetres into the floor", Plan(height=-0.003)),
    way("picked up by its middle", Plan(meeting=handing.held(EXPERT, grip=0.010))),
    way("picked up by its end", Plan(meeting=handing.held(EXPERT, grip=0.036))),
    way("picked up by the fingertips", Plan(meeting=handing.held(EXPERT, height=0.034))),
    way("picked up deep", Plan(meeting=handing.held(EXPERT, height=0.018))),
    way("picked up by a tilted hand", Plan(meeting=handing.held(EXPERT, tilt=0.3))),
    way("handed over upright", Plan(meeting=replace(EXPERT, rise=math.radians(60)))),
    way("half the speed", slowness=2),
    way("trembling", tremble=0.01),
    way("the left arm gives", Plan(meeting=handing.held(EXPERT, giver=Side.LEFT)), seed=0),
)


def sample(rng: np.random.Generator) -> Way:
    """A way at random."""
    slant = math.radians(rng.uniform(0, 45))
    bar, grip_at = handing.random_grasps(rng, BAR, 0.044)
    if rng.random() < 0.2:
        bar = replace(bar, giver=Side.LEFT)
    meeting = handing.Meeting(
        bar=bar,
        centre=(rng.uniform(0.45, 0.55), rng.uniform(-0.05, 0.05), rng.uniform(0.28, 0.38)),
        rise=math.radians(rng.uniform(10, 60)),
        grip_at=grip_at,
        slant=slant,
    )
    plan = Plan(
        meeting=meeting,
        lean=slant + rng.uniform(0.0, 0.7),
        height=rng.uniform(-0.003, RIM_HEIGHT - FLOOR + 0.05),
        x=rng.uniform(-0.03, 0.03),
        y=rng.uniform(-0.04, 0.01),
    )
    slowness, tremble = handing.random_tempo(rng)
    return way(how=plan, slowness=slowness, tremble=tremble)
