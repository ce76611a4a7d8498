"""Sincere ways of transfer_gate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from duobench.experts.motion import Arms, Script, move
from duobench.experts.scripts.transfer_gate import (
    BAR,
    BEYOND,
    LEAN,
    RECEIVER_GRIP,
    RISE,
    leave,
    ring,
)
from duobench.objects.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.objects.gate import MAT_EDGE, MAT_THICKNESS
from duobench.sim.simulation import Simulation
from tests.sincere import handing
from tests.sincere.sincere import Way, ways_to

BEFORE = -0.14
"""Where the block's centre waits before the ring, along its axis, in metres."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """How the block goes through the ring and onto the mat."""

    bar_grip: float = BAR.grip
    """Where the giver holds it, in metres from its centre."""
    bar_height: float = BAR.height
    """Height of the giver's tool when it clasps the lying block, in metres."""
    tilt: float = 0.0
    """Tilt of the giver's hand then, in radians."""
    grip_at: float = RECEIVER_GRIP
    """Where the receiver clasps it."""
    slant: float = 0.0
    """Angle in radians between the receiver's tool and the block."""
    rise: float = RISE
    """Angle of the block in the ring above the horizontal, in radians."""
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

    def script(self, arms: Arms) -> Script:
        bar = replace(BAR, grip=self.bar_grip, height=self.bar_height, tilt=self.tilt)
        x, y, z = ring(arms)
        meeting = handing.Meeting(
            bar=bar,
            centre=(x + self.aside, y + self.beyond, z),
            rise=self.rise,
            grip_at=self.grip_at,
            slant=self.slant,
            lean=LEAN,
            before=self.beyond - BEFORE,
        )
        yield from handing.hand_over(arms, meeting)
        giver, side = bar.giver, bar.giver.other
        yield from leave(arms, giver)
        pulled = arms.targets[side].moved(x=0.06, y=0.12, z=0.03)
        yield from move(arms, {side: pulled}, arrive=False)
        pose = handing.leaning(arms, side, BAR.body, self.lean)
        spot = arms.sim.position("mat") + np.array(
            [self.x, self.y, MAT_THICKNESS / 2 + self.height]
        )
        shift = spot - handing.low_end(pose, LONG_BLOCK, CUBE_EDGE)
        low = MAT_THICKNESS + max(0.0, self.height)
        yield from handing.put_down(arms, side, BAR.body, pose.moved(*shift), low=low)


def done(sim: Simulation) -> bool:
    """The block rests on the mat, and nobody touches it."""
    x, y, _ = sim.relative_position("block", "mat")
    return (
        max(abs(x), abs(y)) < MAT_EDGE / 2
        and sim.contacts.partners("block") == {"mat"}
        and handing.at_rest(sim.speed("block"))
    )


way = ways_to(lambda arms, plan: plan.script(arms), done, Plan())


WAYS: tuple[Way, ...] = (
    way("handed over in the ring, before the plane", Plan(beyond=-0.020)),
    way("handed over in the ring, at the plane", Plan(beyond=-0.003)),
    way("handed over in the ring, just behind the plane", Plan(beyond=0.004)),
    way("received deep in the fingers", Plan(bar_grip=0.036, grip_at=0.012)),
    way("received at the fingertips", Plan(grip_at=0.042)),
    way("let go a millimetre above the mat", Plan(height=0.001)),
    way("let go eight millimetres above the mat", Plan(height=0.008)),
    way("pressed three millimetres into the mat", Plan(height=-0.003)),
    way(
        "laid down flat",
        Plan(slant=math.radians(50), lean=math.radians(89), grip_at=0.034, y=-0.03),
    ),
    # In the layouts before it the closing hand tears the block out of the other one.
    way("picked up by its middle", Plan(bar_grip=0.018), seed=2),
    way("picked up deep", Plan(bar_height=0.018)),
    way("picked up by the fingertips", Plan(bar_height=0.034)),
    way("picked up by a tilted hand", Plan(tilt=0.3)),
    way("off the axis of the ring", Plan(aside=0.02)),
    way("half the speed", slowness=2),
    way("trembling", tremble=0.01),
)


def sample(rng: np.random.Generator) -> Way:
    """A way at random."""
    bar, grip_at = handing.random_grasps(rng, BAR, 0.042)
    flat = rng.random() < 0.25
    plan = Plan(
        bar_grip=bar.grip,
        bar_height=bar.height,
        tilt=bar.tilt,
        grip_at=grip_at,
        slant=math.radians(rng.uniform(40, 50) if flat else rng.uniform(0, 15)),
        rise=math.radians(rng.uniform(40, 50)),
        beyond=rng.uniform(-0.030, 0.030),
        aside=rng.uniform(-0.015, 0.015),
        lean=math.radians(rng.uniform(86, 90) if flat else rng.uniform(0, 5)),
        height=rng.uniform(-0.003, 0.009),
        x=rng.uniform(-0.05, 0.05),
        y=rng.uniform(-0.05, 0.02),
    )
    slowness, tremble = handing.random_tempo(rng)
    return way(how=plan, slowness=slowness, tremble=tremble)
