"""Sincere ways to balance a beam on a cube with two blocks that both arms put down together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain

import numpy as np

from duobench.experts.motion import Arms, Script, move, release, together, wait
from duobench.experts.scripts.block_balance import lay_beam, lower, take_block
from duobench.sim.simulation import Simulation
from duobench.types import CONTROL_HZ, SIDES, Side
from tests.sincere.sincere import Way, ways_to
from tests.steps import do

LEFT, RIGHT = SIDES
BLOCKS = ("left_block", "right_block")
LEVEL, STANDING = math.radians(12.0), math.radians(20.0)
"""Largest tilts of a level beam [task definitions] and of a block that stands on it."""
END = 0.060
"""Distance in metres from the beam's middle from which on a block alone tips it."""
SLOW = 0.02
"""Speed in m/s below which things stand still."""
HOVER = 0.03
"""How high above the beam blocks wait before they go down one after the other, in metres."""
SLOWLY = 0.15
"""Share of the ways taken at random that go at half the speed."""
TREMBLES = (0.0, 0.0, 0.0, 0.01)
"""Trembling of ways taken at random, in radians."""


def done(sim: Simulation) -> bool:
    """Both blocks stand on the ends of the level beam, it on the cube, and no arm is at them."""
    props = ("cube", "beam", *BLOCKS)
    hands = any(sim.contacts.arm(side, prop) for side in SIDES for prop in props)
    left, right = (sim.relative_position(block, "beam")[1] for block in BLOCKS)
    return (
        not hands
        and all(sim.contacts.partners(block) == {"beam"} for block in BLOCKS)
        and sim.contacts.partners("beam") == {"cube", *BLOCKS}
        and min(abs(left), abs(right)) >= END
        and left * right < 0.0
        and sim.rotation("beam")[2, 2] >= math.cos(LEVEL)
        and all(sim.rotation(block)[2, 2] >= math.cos(STANDING) for block in BLOCKS)
        and all(sim.speed(prop)[0] < SLOW for prop in props)
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Building:
    """How it is built; the defaults are the expert's way."""

    beam_arm: Side = RIGHT
    """The arm that lays the beam."""
    along: float = 0.0
    """Where it grasps the beam, from its middle, in metres."""
    beam_gap: float = 0.001
    """Height above the cube at which it lets the beam go, in metres."""
    heights: tuple[float, float] = (0.018, 0.018)
    """Height of each tool above its block's middle in metres when it grasps."""
    first: Side | None = None
    """The arm that takes its block first; both at once where none is given."""
    reach: float = 0.078
    """Distance of the blocks from the middle of the beam, in metres."""
    gap: float = -0.0005
    """Height above the beam to which the blocks are led, in metres; pressed in below 0."""
    pause: int = 4
    """Control steps before they are let go."""
    release: tuple[tuple[Side, ...], ...] = (SIDES,)
    """The arms that let go together, one group after the other."""


def build(arms: Arms, way: Building) -> Script:
    """One arm lays the beam, both take their blocks, put them down together and let go."""
    yield from lay_beam(arms, way.beam_arm, way.along, way.beam_gap)
    if way.first is None:
        takes = [take_block(arms, side, way.heights[side.index]) for side in SIDES]
        yield from together(*takes)
    else:
        for side in (way.first, way.first.other):
            yield from take_block(arms, side, way.heights[side.index])
    yield from lower(arms, reach=way.reach, gap=way.gap)
    yield from wait(way.pause)
    yield from leave(arms, *way.release)


def leave(arms: Arms, *groups: tuple[Side, ...]) -> Script:
    for sides in groups:
        yield from release(arms, *sides)
    yield from wait(4)
    yield from move(arms, {side: arms.targets[side].moved(z=0.15) for side in SIDES}, speed=0.2)


def down_by(arms: Arms, height: float, *sides: Side) -> Script:
    low = {side: arms.targets[side].moved(z=-height) for side in sides}
    yield from move(arms, low, speed=0.1)


def apart(arms: Arms, seconds: float, *, twice: bool = False) -> Script:
    """One block comes onto the beam so much later than the other; `twice` both are raised after
    that, and put on again together.
    """
    yield from lay_beam(arms)
    yield from together(*(take_block(arms, side) for side in SIDES))
    yield from lower(arms, gap=HOVER)
    late = chain(wait(round(seconds * CONTROL_HZ)), down_by(arms, HOVER, RIGHT))
    yield from together(down_by(arms, HOVER, LEFT), late)
    if twice:
        yield from down_by(arms, -HOVER, *SIDES)
        yield from down_by(arms, HOVER, *SIDES)
    yield from wait(4)
    yield from leave(arms, SIDES)


way = ways_to(build, done, Building())


WAYS: tuple[Way, ...] = (
    *(
        way(
            f"blocks grasped {height} mm above their middle", Building(heights=(height / 1000,) * 2)
        )
        for height in (-10, 0, 10, 30)
    ),
    way("one block grasped deep, one at the fingertips", Building(heights=(-0.008, 0.028))),
    *(
        way(f"let go together {gap} mm above the beam", Building(gap=gap / 1000))
        for gap in (1, 4, 7)
    ),
    way("pressed 3 mm into the beam", Building(gap=-0.003)),
    way("the beam laid by the left arm", Building(beam_arm=LEFT)),
    way("the beam grasped beside its middle", Building(along=0.03)),
    way("the beam let go 5 mm above the cube", Building(beam_gap=0.005)),
    way("the left block taken first", Building(first=LEFT)),
    way("the right block taken first", Building(first=RIGHT)),
    way("blocks nearer to the middle", Building(reach=0.068)),
    way("blocks at the very ends", Building(reach=0.084)),
    *(
        way(f"one block {seconds} s after the other", script=do((apart, seconds)))
        for seconds in (0.5, 1.0)
    ),
    way("put on, raised, and put on again", script=do((apart, 0.5, {"twice": True}))),
    way("the left arm lets go first", Building(release=((LEFT,), (RIGHT,)))),
    way("at half the speed", slowness=2),
    way("trembling", tremble=0.01),
)


def sample(rng: np.random.Generator) -> Way:
    """A way taken at random over how the beam is laid and the blocks are taken and put down."""
    releases = ((SIDES,), ((LEFT,), (RIGHT,)), ((RIGHT,), (LEFT,)))
    release_order = releases[rng.choice(len(releases), p=(0.8, 0.1, 0.1))]
    # Who lets go one arm after the other has both blocks standing.
    highest = 0.006 if len(release_order) == 1 else -0.0005
    building = Building(
        beam_arm=SIDES[rng.integers(2)],
        along=rng.uniform(-0.03, 0.03),
        beam_gap=rng.uniform(0.0, 0.006),
        heights=(rng.uniform(-0.010, 0.030), rng.uniform(-0.010, 0.030)),
        first=(None, LEFT, RIGHT)[rng.integers(3)],
        reach=rng.uniform(0.066, 0.084),
        gap=rng.uniform(-0.003, highest),
        pause=int(rng.integers(0, 15)),
        release=release_order,
    )
    slowness = 2 if rng.random() < SLOWLY else 1
    tremble = float(rng.choice(TREMBLES))
    return way(how=building, slowness=slowness, tremble=tremble)
