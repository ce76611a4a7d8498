"""Ways to balance a beam on a cube with two blocks that both arms put down, and to seem to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import chain

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.tasks.block_balance import BEAM, BLOCK, BLOCKS, CUBE_EDGE, LEVEL_DEGREES
from duobench.tasks.experts.handling import pick, place, tool_for
from duobench.tasks.experts.motion import (
    CAREFUL,
    Arms,
    Script,
    down,
    grip,
    move,
    release,
    together,
    wait,
)
from duobench.tasks.experts.scripts.block_balance import lay_beam, lower, take_block
from duobench.world.scene.naming import TABLE
from duobench.world.sim.simulation import Simulation
from tests.steps import do, pause, to
from tests.ways.way import ONE, SLOW, TURNS, Way, cheats, fingers_on, random_tempo, ways_to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
NEAR, FAR = 0.032, 0.078
"""Distances in metres of a block from the beam's middle: where one alone does not tip it, and at
its end."""
GRASP, BEAM_GRASP = 0.020, 0.014
"""Heights in metres of the tool above a block's middle, and above the beam's."""
BESIDE, OFF_CENTRE = 0.03, 0.004
"""Height in metres of the middle of a beam that is held beside the cube, and how far outside the
cube the middle of one is that slides off it."""
LEVEL, STANDING = math.radians(12.0), math.radians(20.0)
"""Largest tilts of a level beam [task definitions] and of a block that stands on it."""
END, HOVER = 0.060, 0.03
"""Distance in metres from the beam's middle from which on a block alone tips it, and how high above
the beam blocks wait before they go down one after the other."""


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


def held_balance(sim: Simulation) -> bool:
    """The same, with a gripper at a block."""
    on_beam = all(
        sim.contacts.between(name, "beam") and not sim.contacts.between(name, TABLE)
        for name in BLOCKS
    )
    hands = [sim.contacts.gripper(side, name) for side in SIDES for name in BLOCKS]
    return on_beam and sum(hands) == 1


def against_the_cube(sim: Simulation) -> bool:
    """The beam is in the hand, off the table, and touches the cube."""
    touching = sim.contacts.partners("beam") >= {"cube"} and TABLE not in sim.contacts.partners(
        "beam"
    )
    return touching and sim.contacts.grasped(RIGHT, "beam") and sim.speed("beam")[0] < 0.01


def let_go_on_the_cube(sim: Simulation) -> bool:
    """The beam, let go, still looks as if it lay on the cube."""
    level = (
        sim.rotation("beam")[2, 2] > math.cos(math.radians(LEVEL_DEGREES))
        and sim.position("beam")[2] > CUBE_EDGE
    )
    return level and sim.contacts.partners("beam") == {"cube"}


def outward(side: Side) -> float:
    """Yaw at which the fingers open along x and the wrist camera points away."""
    return side.sign * math.pi / 2


def away(arms: Arms, side: Side) -> Script:
    """Let go, go up, and out of the other arm's way."""
    yield from release(arms, side)
    yield from to(arms, side, arms.targets[side].moved(z=0.15), speed=0.3)
    yield from aside(arms, side)


def aside(arms: Arms, side: Side) -> Script:
    yield from to(arms, side, arms.targets[side].moved(y=0.2 * side.sign), arrive=False)


def put_near(arms: Arms, side: Side, name: str) -> Script:
    x, y, z = arms.sim.position(name)
    grasp = down(x, y, z + GRASP, yaw=outward(side))
    yield from pick(arms, side, grasp, above=0.12, lift=0.14, speed=0.3)
    half = math.copysign(NEAR, y)
    beam = arms.sim.pose("beam")
    goal = beam @ SE3.at(0.0, half, (BEAM[2] + BLOCK[2]) / 2 + 0.0005)
    tool = tool_for(arms, side, name, SE3.at(*goal.translation, yaw=beam.yaw))
    yield from to(arms, side, tool.moved(z=0.06), speed=0.3)
    yield from wait(6)
    yield from to(arms, side, tool, speed=0.06)
    yield from wait(6)
    yield from away(arms, side)


def slide(arms: Arms, side: Side, name: str) -> Script:
    x, y, z = arms.sim.position(name)
    tool = down(x, y, z + GRASP, yaw=outward(side))
    yield from to(arms, side, tool.moved(z=0.12), speed=0.3)
    yield from to(arms, side, tool, speed=CAREFUL)
    yield from grip(arms, side)
    out = math.copysign(FAR, arms.sim.relative_position(name, "beam")[1])
    shift = out - arms.sim.relative_position(name, "beam")[1]
    yield from to(arms, side, arms.targets[side].moved(y=shift), speed=0.05)
    yield from wait(6)
    yield from away(arms, side)


def build(arms: Arms, *sides: Side) -> Script:
    """Both blocks near the middle, then slid out, each by the arm that is given for it."""
    for act in (put_near, slide):
        for side, name in zip(sides, BLOCKS, strict=True):
            yield from act(arms, side, name)


def take_both(arms: Arms) -> Script:
    yield from together(*(take_block(arms, side) for side in SIDES))


def tool_at(arms: Arms, side: Side) -> SE3:
    x, y, z = arms.sim.position(f"{side}_block")
    return down(x, y, z + GRASP, yaw=outward(side))


def close_once(arms: Arms) -> Script:
    for side in SIDES:
        tool = tool_at(arms, side)
        yield from to(arms, side, tool.moved(z=0.12))
        yield from to(arms, side, tool, speed=CAREFUL)
    yield from grip(arms, *SIDES)
    yield from both_away(arms)


def both_away(arms: Arms) -> Script:
    yield from together(*(away(arms, side) for side in SIDES))


def grasp_on_the_beam(arms: Arms, lift: float) -> Script:
    tools = {side: tool_at(arms, side) for side in SIDES}
    yield from move(arms, {side: tool.moved(z=0.12) for side, tool in tools.items()})
    yield from move(arms, tools, speed=CAREFUL)
    yield from grip(arms, *SIDES)
    yield from wait(5)
    if lift:
        for height in (lift, 0.0):
            raised = {side: tool.moved(z=height) for side, tool in tools.items()}
            yield from move(arms, raised, speed=0.05)
            yield from wait(3)
    yield from both_away(arms)


def press(arms: Arms) -> Script:
    yield from lay_beam(arms)
    arms.openings[:] = 0.12
    tops = {}
    for side in SIDES:
        x, y, _ = arms.sim.position(f"{side}_block")
        tops[side] = down(x, y, BLOCK[2] + 0.018, yaw=outward(side))
    yield from move(arms, {side: top.moved(z=0.08) for side, top in tops.items()})
    yield from move(arms, {side: top.moved(z=-0.012) for side, top in tops.items()}, speed=0.1)
    yield from wait(15)


def beside(arms: Arms) -> Script:
    x, y, z = arms.sim.position("beam")
    yield from pick(arms, RIGHT, down(x, y - 0.06, z + BEAM_GRASP, yaw=outward(RIGHT)))
    x, y, _ = arms.sim.position("cube")
    near = x - (CUBE_EDGE + BEAM[0]) / 2
    for gap in (0.04, 0.0):
        goal = tool_for(arms, RIGHT, "beam", SE3.at(near - gap, y, BESIDE))
        yield from to(arms, RIGHT, goal.moved(x=0.002), speed=0.1)
    yield from wait(30)


def lay_aslant(arms: Arms) -> Script:
    """The beam is laid so far off its middle that it slides off, once it is let go."""
    x, y, z = arms.sim.position("beam")
    yield from pick(arms, RIGHT, down(x, y, z + BEAM_GRASP, yaw=outward(RIGHT)))
    x, y, _ = arms.sim.position("cube")
    lying = SE3.at(x, y - CUBE_EDGE / 2 - OFF_CENTRE, CUBE_EDGE + BEAM[2] / 2)
    goal = tool_for(arms, RIGHT, "beam", lying)
    yield from place(arms, RIGHT, goal, above=0.06, retreat=0.15, speed=0.3)


def put_on_and_off(arms: Arms) -> Script:
    before = dict(arms.targets)
    yield from lower(arms)
    there = dict(arms.targets)
    yield from move(arms, {side: tool.moved(z=0.10) for side, tool in there.items()}, speed=0.2)
    yield from move(arms, before, speed=0.2)
    yield from move(arms, {side: tool.moved(z=-0.12) for side, tool in before.items()}, speed=0.1)
    yield from both_away(arms)


def hops(arms: Arms, period: float, times: int, height: float = 0.022) -> Script:
    """One block hops on the beam in its hand, again and again, before the other one comes."""
    yield from lower(arms, LEFT)
    low = arms.targets[LEFT]
    for _ in range(times):
        yield from wait(round(period * CONTROL_HZ / 2))
        yield from to(arms, LEFT, low.moved(z=height), speed=0.1)
        yield from to(arms, LEFT, low, speed=0.1)
        yield from wait(round(period * CONTROL_HZ / 2))
    yield from lower(arms, RIGHT)


ALONE = (build, RIGHT, RIGHT)
LADEN = do(lay_beam, take_both)
in_turns = do((lay_beam, RIGHT), (aside, RIGHT), (build, LEFT, RIGHT))
cheat = cheats(done)
ADVERSARIES: dict[str, Way] = {
    "one arm puts one block on after the other, and slides them out": cheat(
        2, lay_beam, ALONE, **ONE
    ),
    "each arm puts its block on and slides it out, in turns": cheat(2, in_turns, **TURNS),
    "both grasp the blocks once on the table, then one arm builds it": cheat(
        3, lay_beam, close_once, ALONE
    ),
    "built in turns, then both grasp the blocks on the beam": cheat(
        3, in_turns, (grasp_on_the_beam, 0.0)
    ),
    "built in turns, then both raise the blocks on the beam by 5 mm": cheat(
        3, in_turns, (grasp_on_the_beam, 0.005)
    ),
    "the beam is held in the hand against the cube": cheat(1, beside, **ONE, deed=against_the_cube),
    "the beam is laid so that it slides off": cheat(1, lay_aslant, **ONE, deed=let_go_on_the_cube),
    "one block waits on the beam, in the hand, for the other one": cheat(
        3,
        LADEN,
        (lower, LEFT),
        (pause, 60),
        (lower, RIGHT),
        (away, RIGHT),
        (pause, 30),
        (away, LEFT),
        lacks="left_block is there before right_block",
    ),
    **{
        f"one block hops every {period} s and waits for the other one": cheat(
            3, LADEN, (hops, float(period), times), both_away, lacks="left_block is there before"
        )
        for period, times in (("0.2", 6), ("0.5", 4))
    },
    "both let their blocks go 2 cm above the beam": cheat(
        3, LADEN, (lower, {"gap": 0.02}), (release, *SIDES), (pause, 15), both_away
    ),
    "half-open fingers pressed on the blocks": cheat(
        2, press, deed=fingers_on({side: f"{side}_block" for side in SIDES})
    ),
    "a balance held by a gripper": cheat(
        4,
        LADEN,
        lower,
        (away, LEFT),
        (pause, 60),
        deed=held_balance,
        lacks="right arm touches right_block",
    ),
    "built by both, taken down, and built again by one arm": cheat(4, LADEN, put_on_and_off, ALONE),
}

# --- sincere ways ---------------------------------------------------------------------------------


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


def build_together(arms: Arms, way: Building) -> Script:
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
    yield from take_both(arms)
    yield from lower(arms, gap=HOVER)
    late = chain(wait(round(seconds * CONTROL_HZ)), down_by(arms, HOVER, RIGHT))
    yield from together(down_by(arms, HOVER, LEFT), late)
    if twice:
        yield from down_by(arms, -HOVER, *SIDES)
        yield from down_by(arms, HOVER, *SIDES)
    yield from wait(4)
    yield from leave(arms, SIDES)


way = ways_to(build_together, done, Building())
SINCERE: dict[str, Way] = {
    **{
        f"blocks grasped {height} mm above their middle": way(heights=(height / 1000,) * 2)
        for height in (-10, 0, 10, 30)
    },
    "one block grasped deep, one at the fingertips": way(heights=(-0.008, 0.028)),
    **{f"let go together {gap} mm above the beam": way(gap=gap / 1000) for gap in (1, 4, 7)},
    "pressed 3 mm into the beam": way(gap=-0.003),
    "the beam laid by the left arm": way(beam_arm=LEFT),
    "the beam grasped beside its middle": way(along=0.03),
    "the beam let go 5 mm above the cube": way(beam_gap=0.005),
    "the left block taken first": way(first=LEFT),
    "the right block taken first": way(first=RIGHT),
    "blocks nearer to the middle": way(reach=0.068),
    "blocks at the very ends": way(reach=0.084),
    **{
        f"one block {seconds} s after the other": way(script=do((apart, seconds)))
        for seconds in (0.5, 1.0)
    },
    "put on, raised, and put on again": way(script=do((apart, 0.5, {"twice": True}))),
    "the left arm lets go first": way(release=((LEFT,), (RIGHT,))),
    "at half the speed": way(slowness=2),
    "trembling": way(tremble=0.01),
}


def sample(rng: np.random.Generator) -> Way:
    releases = ((SIDES,), ((LEFT,), (RIGHT,)), ((RIGHT,), (LEFT,)))
    release = releases[rng.choice(len(releases), p=(0.8, 0.1, 0.1))]
    return way(
        beam_arm=SIDES[rng.integers(2)],
        along=rng.uniform(-0.03, 0.03),
        beam_gap=rng.uniform(0.0, 0.006),
        heights=tuple(rng.uniform(-0.010, 0.030, 2).tolist()),
        first=(None, LEFT, RIGHT)[rng.integers(3)],
        reach=rng.uniform(0.066, 0.084),
        # Who lets go one arm after the other has both blocks standing.
        gap=rng.uniform(-0.003, 0.006 if len(release) == 1 else -0.0005),
        pause=int(rng.integers(0, 15)),
        release=release,
        **random_tempo(rng, trembling=0.25),
    )
