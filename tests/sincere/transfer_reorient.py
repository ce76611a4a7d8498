"""Sincere ways of transfer_reorient."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from duobench.experts.handover import let_go
from duobench.experts.motion import Arms, Script, release, wait
from duobench.experts.scripts.transfer_reorient import (
    BAR,
    MEETING_POINT,
    RECEIVER_GRIP,
    RISE,
    lead,
    upright,
)
from duobench.objects.hexagon_peg import BOARD_HEIGHT, HEXAGON
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.types import Side
from tests.sincere import handing
from tests.sincere.sincere import Way, ways_to
from tests.steps import clear_of

EXPERT = handing.Meeting(
    bar=BAR,
    centre=tuple(MEETING_POINT.tolist()),
    rise=RISE,
    grip_at=RECEIVER_GRIP,
)
DEEP_ENOUGH = 0.015
"""How deep the peg is in the hole at least, in metres [task definitions]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """How the peg goes into the hole."""

    meeting: handing.Meeting = EXPERT
    depth: float = 0.024
    """How deep its tip is led into the hole before it is let go, in metres; above it below 0."""
    aside: float = 0.0
    """How far beside the hole's axis the tip is then, in metres."""
    retreat: bool = True
    """Whether the hand is drawn back, or only opened."""

    def script(self, arms: Arms) -> Script:
        yield from handing.hand_over(arms, self.meeting)
        giver, side = self.meeting.bar.giver, self.meeting.bar.giver.other
        yield from clear_of(arms, giver)
        hole = arms.sim.pose("board") @ SE3.at(HEXAGON.x, 0.0, BOARD_HEIGHT)
        goal = upright(arms, side, hole)
        for height, speed in ((0.16, 0.4), (0.06, 0.4), (0.010, 0.12), (0.004, 0.12)):
            if height >= -self.depth:
                yield from lead(arms, side, goal.moved(x=self.aside, z=height), speed=speed)
        yield from lead(arms, side, goal.moved(x=self.aside, z=-self.depth), speed=0.06)
        handing.check(
            arms.sim.min_height(BAR.body) < BOARD_HEIGHT + max(0.0, -self.depth) + handing.SEEN
        )
        if self.retreat:
            yield from let_go(arms, side)
        else:
            yield from release(arms, side)
            yield from wait(10)


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


way = ways_to(lambda arms, plan: plan.script(arms), done, Plan())


DEEP = replace(EXPERT, grip_at=0.014)
WAYS: tuple[Way, ...] = (
    way("received deep in the fingers", Plan(meeting=handing.held(DEEP, grip=0.036))),
    way("received at the fingertips", Plan(meeting=replace(EXPERT, grip_at=0.042))),
    way("let go with the tip in the hole", Plan(depth=0.006)),
    *(way(f"let go {high} mm above the hole", Plan(depth=-high / 1000)) for high in (1, 3, 6, 9)),
    way("let go 3 mm above the hole and 2 mm beside it", Plan(depth=-0.003, aside=0.002)),
    way("let go half-way", Plan(depth=0.012)),
    way("pressed onto the hole's floor", Plan(depth=0.029)),
    way("the hand only opens", Plan(retreat=False)),
    way("picked up by its middle", Plan(meeting=handing.held(EXPERT, grip=0.016))),
    way("picked up by its end", Plan(meeting=handing.held(EXPERT, grip=0.038))),
    way("picked up by the fingertips", Plan(meeting=handing.held(EXPERT, height=0.033))),
    way("picked up deep", Plan(meeting=handing.held(EXPERT, height=0.019))),
    way("picked up by a tilted hand", Plan(meeting=handing.held(EXPERT, tilt=0.2))),
    way("handed over nearly level", Plan(meeting=replace(EXPERT, rise=math.radians(30)))),
    way("half the speed", slowness=2),
    way("trembling", tremble=0.01),
    way("the left arm gives", Plan(meeting=handing.held(EXPERT, giver=Side.LEFT))),
)


def sample(rng: np.random.Generator) -> Way:
    """A way at random."""
    bar, grip_at = handing.random_grasps(rng, BAR, 0.042)
    if rng.random() < 0.2:
        bar = replace(bar, giver=Side.LEFT)
    meeting = handing.Meeting(
        bar=bar,
        centre=(rng.uniform(0.47, 0.53), rng.uniform(-0.03, 0.03), rng.uniform(0.36, 0.40)),
        rise=math.radians(rng.uniform(30, 65)),
        grip_at=grip_at,
        slant=math.radians(rng.uniform(0, 10)),
    )
    plan = Plan(meeting=meeting, depth=rng.uniform(-0.008, 0.028), retreat=bool(rng.random() < 0.7))
    slowness, tremble = handing.random_tempo(rng)
    return way(how=plan, slowness=slowness, tremble=tremble)
