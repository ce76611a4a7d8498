"""How one might cheat in block_balance."""

from __future__ import annotations

import math

from duobench.experts.handling import pick, place, tool_for
from duobench.experts.motion import CAREFUL, Arms, Script, down, grip, move, release, together, wait
from duobench.experts.scripts.block_balance import lay_beam, lower, take_block
from duobench.scene.naming import TABLE
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.block_balance import BEAM, BLOCK, BLOCKS, CUBE_EDGE, LEVEL_DEGREES, TIPPING
from duobench.types import SIDES, Side
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.steps import do, pause, to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
NEAR, FAR = 0.032, 0.078
"""Distances in metres of a block from the beam's middle: where one alone does not tip it, and at
its end."""
GRASP = 0.020
"""Height in metres of the tool above a block's middle."""
BEAM_GRASP = 0.014
"""Height in metres of the tool above the beam's middle."""
BESIDE = 0.03
"""Height in metres of the beam's middle while it is held beside the cube."""
OFF_CENTRE = 0.004
"""How far outside the cube the middle of a beam is that slides off it, in metres."""


def balanced(sim: Simulation) -> bool:
    """Both blocks are on the ends of a level beam that rests on the cube."""
    places = sorted(sim.relative_position(name, "beam")[1] for name in BLOCKS)
    return (
        places[0] < -TIPPING
        and places[1] > TIPPING
        and all(sim.contacts.partners(name) == {"beam"} for name in BLOCKS)
        and sim.contacts.between("beam", "cube")
        and sim.rotation("beam")[2, 2] > math.cos(math.radians(LEVEL_DEGREES))
    )


def held_balance(sim: Simulation) -> bool:
    """The same, with a gripper at a block."""
    on_beam = all(
        sim.contacts.between(name, "beam") and not sim.contacts.between(name, TABLE)
        for name in BLOCKS
    )
    hands = [sim.contacts.gripper(side, name) for side in SIDES for name in BLOCKS]
    return on_beam and sum(hands) == 1


def pressed(sim: Simulation) -> bool:
    """Both fingers of either gripper lie on its block."""
    fingers = ("left_finger", "right_finger")
    return all(
        sim.contacts.between(f"{side}/{finger}", f"{side}_block")
        for side in SIDES
        for finger in fingers
    )


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
    """Go out of the other arm's way."""
    yield from to(arms, side, arms.targets[side].moved(y=0.2 * side.sign), arrive=False)


def put_near(arms: Arms, side: Side, name: str) -> Script:
    """One arm puts a block onto its half of the beam, near the middle."""
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
    """One arm slides a block that stands on the beam out to the end."""
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
    """Both blocks near the middle first, one after the other, then slid out one after the other;
    the sides are the arms for the left and the right block.
    """
    for act in (put_near, slide):
        for side, name in zip(sides, BLOCKS, strict=True):
            yield from act(arms, side, name)


def tool_at(arms: Arms, side: Side) -> SE3:
    """Where a tool grasps its block."""
    x, y, z = arms.sim.position(f"{side}_block")
    return down(x, y, z + GRASP, yaw=outward(side))


def close_once(arms: Arms) -> Script:
    """Both grasp a block, on the table."""
    for side in SIDES:
        tool = tool_at(arms, side)
        yield from to(arms, side, tool.moved(z=0.12))
        yield from to(arms, side, tool, speed=CAREFUL)
    yield from grip(arms, *SIDES)
    yield from both_away(arms)


def both_away(arms: Arms) -> Script:
    yield from together(*(away(arms, side) for side in SIDES))


def grasp_on_the_beam(arms: Arms, lift: float) -> Script:
    """Both grasp their blocks together, raise them, and let go."""
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
    """Half-open fingers are pressed on top of the blocks."""
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
    """The right arm holds the beam in the air against the cube's side."""
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


def take_both(arms: Arms) -> Script:
    yield from together(*(take_block(arms, side) for side in SIDES))


def put_on_and_off(arms: Arms) -> Script:
    """Both put their blocks down together, and take them off again."""
    before = dict(arms.targets)
    yield from lower(arms)
    there = dict(arms.targets)
    yield from move(arms, {side: tool.moved(z=0.10) for side, tool in there.items()}, speed=0.2)
    yield from move(arms, before, speed=0.2)
    yield from move(arms, {side: tool.moved(z=-0.12) for side, tool in before.items()}, speed=0.1)
    yield from both_away(arms)


ALONE = (build, RIGHT, RIGHT)
LADEN = do(lay_beam, take_both)
in_turns = do((lay_beam, RIGHT), (aside, RIGHT), (build, LEFT, RIGHT))
cheat = cheats(balanced)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat(
        "one arm puts one block on after the other, and slides them out", 2, lay_beam, ALONE, **ONE
    ),
    cheat("each arm puts its block on and slides it out, in turns", 2, in_turns, **TURNS),
    cheat(
        "both grasp the blocks once on the table, then one arm builds it",
        3,
        *(lay_beam, close_once, ALONE),
    ),
    cheat(
        "built in turns, then both grasp the blocks on the beam",
        3,
        *(in_turns, (grasp_on_the_beam, 0.0)),
    ),
    cheat(
        "built in turns, then both raise the blocks on the beam by 5 mm",
        3,
        *(in_turns, (grasp_on_the_beam, 0.005)),
    ),
    cheat("the beam is held in the hand against the cube", 1, beside, **ONE, deed=against_the_cube),
    cheat("the beam is laid so that it slides off", 1, lay_aslant, **ONE, deed=let_go_on_the_cube),
    cheat(
        "one block waits on the beam, in the hand, for the other one",
        3,
        *(LADEN, (lower, LEFT), (pause, 60), (lower, RIGHT)),
        *((away, RIGHT), (pause, 30), (away, LEFT)),
        lacks="left_block is there before right_block",
    ),
    cheat(
        "both let their blocks go 2 cm above the beam",
        3,
        *(LADEN, (lower, {"gap": 0.02}), (release, *SIDES), (pause, 15), both_away),
    ),
    cheat("half-open fingers pressed on the blocks", 2, press, deed=pressed),
    cheat(
        "a balance held by a gripper",
        4,
        *(LADEN, lower, (away, LEFT), (pause, 60)),
        deed=held_balance,
        lacks="right arm touches right_block",
    ),
    cheat("built by both, taken down, and built again by one arm", 4, LADEN, put_on_and_off, ALONE),
)
