"""How one might cheat in join_blocks: leave out that each arm holds its block while they join."""

from __future__ import annotations

import math

from duobench.experts.handling import pick, tool_for
from duobench.experts.motion import CAREFUL, Arms, Script, down, grip, move, release, together, wait
from duobench.experts.scripts.join_blocks import script as expert
from duobench.objects.joint_blocks import (
    BACK_MOUTH,
    BAR,
    FRONT_MOUTH,
    LIGHT_TIP,
    PEG_HEIGHT,
    PEG_LENGTH,
    SOCKET_DEPTH,
    WALL_PLATE,
    WALL_TIP,
)
from duobench.sim.contacts import Limb, limb_owner
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.types import SIDES, Side
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.steps import do, to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
LIGHT, DARK = "light_block", "dark_block"
DEEP = 0.010
"""Depth in metres from which on a peg is inserted."""
LEANS = {LIGHT: math.radians(20.0), DARK: math.radians(-20.0)}
GRASP_X = {LIGHT: -0.012, DARK: 0.0}
GRASP_HEIGHT = 0.026
RETREAT = 0.10
HALF_OPEN = 0.2
"""Opening at which the fingertips are less far apart than a block is wide."""
FINGERTIP = 0.012
"""How far the fingertips reach beyond the tool centre point, in metres."""
BEFORE = 0.02
"""Distance in metres between peg and socket from which a block is pushed in a straight line."""
ROOM = 0.10
"""Distance in metres to the wall at which the arms do not touch it."""
RAISE, NOSE_UP = 0.008, 0.05
"""How far a joined pair is raised, in metres, and turned up, in radians, as it leaves the table."""
SLOW = 0.05
TOUCHING = 0.0005
"""Gap in metres that is left between faces that meet."""


def depth(sim: Simulation, peg: str, tip: SE3, mouth: SE3) -> float:
    """How deep a peg's tip is in a socket of the dark block, in metres; below zero beside it."""
    x, y, z = (sim.pose(DARK) @ mouth).inverse().apply((sim.pose(peg) @ tip).translation)
    inside = math.hypot(x, y) < PEG_LENGTH / 4 and -z < SOCKET_DEPTH
    return float(-z) if inside else -1.0


def joined(sim: Simulation) -> bool:
    return max(depth(sim, LIGHT, LIGHT_TIP, mouth) for mouth in (BACK_MOUTH, FRONT_MOUTH)) > DEEP


def on_wall(sim: Simulation) -> bool:
    return depth(sim, "wall", WALL_TIP, FRONT_MOUTH) > DEEP


def finished(sim: Simulation) -> bool:
    """Both are plugged in and let go."""
    blocks = (LIGHT, DARK)
    left = not any(sim.contacts.gripper(side, block) for side in SIDES for block in blocks)
    return left and joined(sim) and on_wall(sim)


def take(arms: Arms, side: Side, block: str, lift: float = 0.06) -> Script:
    pose = arms.sim.pose(block)
    x, y, _ = pose.apply([GRASP_X[block], 0.0, 0.0])
    grasp = down(x, y, GRASP_HEIGHT, yaw=pose.yaw, tilt=LEANS[block])
    yield from pick(arms, side, grasp, lift=lift)


def lead(arms: Arms, side: Side, block: str, goal: SE3, speed: float = CAREFUL) -> Script:
    """Move a held block to a pose, and there correct what it is off."""
    path = {side: tool_for(arms, side, block, goal)}
    yield from move(arms, path, speed=speed, turn_speed=0.6, tolerance=0.0015)
    for _ in range(3 if speed > SLOW else 0):
        arms.targets[side] = goal @ arms.sim.pose(block).inverse() @ arms.targets[side]
        yield from wait(8)


def push_in(arms: Arms, side: Side, block: str, goal: SE3) -> Script:
    """Bring a held block in front of its goal, then push it there along its own x."""
    before = goal @ SE3.at(-PEG_LENGTH - BEFORE)
    yield from lead(arms, side, block, before.moved(z=0.06))
    yield from lead(arms, side, block, before, speed=0.1)
    yield from lead(arms, side, block, goal, speed=SLOW)


def let_go(arms: Arms, *sides: Side) -> Script:
    yield from release(arms, *sides)
    away = {side: arms.targets[side] @ SE3.at(z=-RETREAT) for side in sides}
    yield from move(arms, away, speed=CAREFUL)


def mounted(arms: Arms) -> SE3:
    """Pose of a dark block on the wall's peg."""
    x = -(WALL_PLATE[0] + BAR[0]) / 2 - TOUCHING
    return arms.sim.pose("wall") @ SE3.at(x, 0.0, PEG_HEIGHT)


def behind(arms: Arms) -> SE3:
    """Pose of a light block in the back socket of the dark one, wherever that is."""
    return arms.sim.pose(DARK) @ SE3.at(-BAR[0] - TOUCHING)


def dark_to_wall(arms: Arms, side: Side, *, hold: bool = False) -> Script:
    yield from take(arms, side, DARK)
    yield from push_in(arms, side, DARK, mounted(arms))
    if not hold:
        yield from let_go(arms, side)


def plug_in_light(arms: Arms, side: Side) -> Script:
    yield from take(arms, side, LIGHT)
    yield from push_in(arms, side, LIGHT, behind(arms))
    yield from let_go(arms, side)


def make_room(arms: Arms, side: Side) -> Script:
    """Move an arm out of the other one's way."""
    yield from to(arms, side, down(0.3, 0.4 * side.sign, 0.3))


def one_after_the_other(arms: Arms, dark: Side, light: Side) -> Script:
    """The dark block onto the wall and let go, then the light one plugged in."""
    yield from dark_to_wall(arms, dark)
    if dark is not light:
        yield from make_room(arms, dark)
    yield from plug_in_light(arms, light)


def take_both(arms: Arms) -> Script:
    """Close on both blocks, on the table."""
    yield from together(take(arms, LEFT, LIGHT, 0.0), take(arms, RIGHT, DARK, 0.0))


def at_the_foot(arms: Arms, side: Side) -> Script:
    """Bring the dark block against the foot of the wall, where it cannot give way."""
    yield from take(arms, side, DARK)
    foot = mounted(arms).moved(z=BAR[2] / 2 - PEG_HEIGHT)
    yield from lead(arms, side, DARK, foot.moved(z=0.02))
    yield from lead(arms, side, DARK, foot, speed=SLOW)


join_on_table = do((at_the_foot, RIGHT), (let_go, RIGHT), (plug_in_light, RIGHT))


def take_joined(arms: Arms) -> Script:
    """What one arm joined on the table is grasped by both, and brought to the wall."""
    yield from join_on_table(arms)
    yield from take(arms, RIGHT, DARK, 0.0)
    yield from to(arms, RIGHT, arms.targets[RIGHT].moved(x=-ROOM), speed=0.1)
    yield from take(arms, LEFT, LIGHT, 0.0)
    goal = mounted(arms)
    before = goal.moved(x=-PEG_LENGTH - BEFORE)
    on_table = before.moved(z=BAR[2] / 2 - PEG_HEIGHT)
    for dark, speed in ((on_table, SLOW), (before, SLOW), (goal, SLOW)):
        light = dark.moved(x=-BAR[0] - TOUCHING)
        there = {
            LEFT: tool_for(arms, LEFT, LIGHT, light),
            RIGHT: tool_for(arms, RIGHT, DARK, dark),
        }
        yield from move(arms, there, speed=speed, turn_speed=0.6, tolerance=0.0015)
    yield from let_go(arms, *SIDES)


def plug_in_and_bring(arms: Arms) -> Script:
    """The left arm plugs the light block into the dark one, and brings both to the wall."""
    yield from take(arms, LEFT, LIGHT)
    goal = behind(arms)
    before = goal @ SE3.at(-PEG_LENGTH - BEFORE)
    yield from lead(arms, LEFT, LIGHT, before.moved(z=0.06))
    yield from lead(arms, LEFT, LIGHT, before, speed=0.1)
    yield from lead(arms, LEFT, LIGHT, goal, speed=SLOW)
    yield from let_go(arms, RIGHT)
    # Raised at its front, the dark block hangs on the peg and does not rub on the table.
    raised = arms.sim.pose(LIGHT).moved(z=RAISE) @ SE3.about((0, 1, 0), -NOSE_UP)
    yield from lead(arms, LEFT, LIGHT, raised, speed=SLOW)
    yield from lead(arms, LEFT, LIGHT, raised.moved(x=-ROOM), speed=SLOW)
    light = mounted(arms).moved(x=-BAR[0] - TOUCHING)
    yield from lead(arms, LEFT, LIGHT, light.moved(x=-PEG_LENGTH - BEFORE), speed=0.1)
    yield from lead(arms, LEFT, LIGHT, light, speed=SLOW)
    yield from let_go(arms, LEFT)


def until_joined(arms: Arms) -> Script:
    """The expert, up to where both blocks are joined."""
    for _ in expert(arms):
        if joined(arms.sim) and max(arms.sim.speed(DARK)) < 0.1:
            return
        yield


def pull_apart(arms: Arms) -> Script:
    """Joined by both arms, pulled apart; one arm then puts one after the other onto the wall."""
    yield from until_joined(arms)
    apart = arms.targets[LEFT].moved(x=-PEG_LENGTH - BEFORE)
    yield from to(arms, LEFT, apart, speed=SLOW)
    yield from to(arms, LEFT, apart.moved(x=-0.12))
    goal = mounted(arms)
    yield from push_in(arms, RIGHT, DARK, goal)
    yield from let_go(arms, RIGHT)
    yield from push_in(arms, LEFT, LIGHT, behind(arms))
    yield from let_go(arms, LEFT)


def never_let_go(arms: Arms) -> Script:
    """The expert, up to where both are on the wall, but its grippers stay closed."""
    for _ in expert(arms):
        if on_wall(arms.sim) and arms.openings.max() > 0.5:
            break
        yield
    arms.openings[:] = 0.0
    yield from wait(60)


def press(arms: Arms) -> Script:
    """Half-open fingers are pressed onto both blocks from above, together."""
    goals = {}
    for side, block in ((LEFT, LIGHT), (RIGHT, DARK)):
        pose = arms.sim.pose(block)
        x, y, _ = pose.translation
        goals[side] = down(x, y, BAR[2] - 0.004 + FINGERTIP, yaw=pose.yaw)
        arms.openings[side.index] = HALF_OPEN
    yield from grip(arms, *SIDES, opening=HALF_OPEN)
    yield from move(arms, {side: goal.moved(z=0.1) for side, goal in goals.items()})
    yield from move(arms, goals, speed=SLOW)
    yield from wait(20)


def pressed(sim: Simulation) -> bool:
    """Both pads of both grippers are in contact with their blocks."""
    pads = (Limb.LEFT_FINGER, Limb.RIGHT_FINGER)
    return all(
        sim.contacts.between(limb_owner(side, pad), block)
        for side, block in ((LEFT, LIGHT), (RIGHT, DARK))
        for pad in pads
    )


cheat = cheats(finished)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("half-open fingers press on both blocks", 0, press, deed=pressed),
    cheat(
        "one arm puts the dark block onto the wall and plugs in the light one",
        0,
        (one_after_the_other, RIGHT, RIGHT),
        **ONE,
    ),
    cheat(
        "one arm puts the dark block onto the wall, the other plugs in the light one",
        0,
        (one_after_the_other, RIGHT, LEFT),
        **TURNS,
    ),
    cheat(
        "both blocks are grasped once, then one arm does the rest",
        1,
        *(take_both, (let_go, *SIDES), (make_room, LEFT), (one_after_the_other, RIGHT, RIGHT)),
    ),
    cheat(
        "the blocks are joined on the wall, by both arms",
        1,
        *((dark_to_wall, RIGHT, {"hold": True}), (plug_in_light, LEFT), (let_go, RIGHT)),
    ),
    cheat(
        "one arm joins the blocks on the table, against the wall",
        0,
        join_on_table,
        **ONE,
        deed=joined,
    ),
    cheat("one arm joins the blocks on the table, both bring them to the wall", 1, take_joined),
    cheat(
        "one arm only closes on a block that lies on the table",
        1,
        *((take, RIGHT, DARK, 0.0), plug_in_and_bring),
        deed=joined,
        seed=1,
    ),
    cheat(
        "one arm only closes on a block that the wall keeps in its place",
        1,
        *((at_the_foot, RIGHT), plug_in_and_bring),
    ),
    cheat("joined, pulled apart, and put onto the wall one after the other", 2, pull_apart),
    cheat(
        "never lets go of what is on the wall",
        2,
        never_let_go,
        deed=on_wall,
        lacks="left still touches light_block",
    ),
)
