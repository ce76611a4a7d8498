"""Ways to join two blocks, each in an arm's hand, and push them onto the wall, and to seem to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.experts.handling import pick, place, tool_for
from duobench.tasks.experts.motion import (
    CAREFUL,
    NEAR,
    Arms,
    Script,
    down,
    grip,
    move,
    release,
    together,
    wait,
)
from duobench.tasks.experts.scripts.join_blocks import script as expert
from duobench.world.objects.joint_blocks import (
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
from duobench.world.sim.simulation import Simulation
from tests.steps import do, to
from tests.ways.way import ONE, TURNS, Way, cheats, fingers_on, left_alone, random_tempo, ways_to

LEFT, RIGHT = Side.LEFT, Side.RIGHT
LIGHT, DARK = "light_block", "dark_block"
DEEP = 0.010
"""Depth in metres from which on a peg is inserted."""
GRASP_HEIGHT, RETREAT = 0.026, 0.10
HALF_OPEN, FINGERTIP = 0.2, 0.012
"""Opening at which the fingertips are less far apart than a block is wide, and how far they reach
beyond the tool centre point, in metres."""
BEFORE, ROOM = 0.02, 0.10
"""Distances in metres between peg and socket from which a block is pushed in a straight line, and
to the wall at which the arms do not touch it."""
RAISE, NOSE_UP = 0.008, 0.05
"""How far a joined pair is raised, in metres, and turned up, in radians, as it leaves the table."""
SLOW = 0.05
TOUCHING = 0.0005
"""Gap in metres that is left between faces that meet."""
SHORT, OFF, ASKEW = 0.014, 0.005, math.radians(12.0)
"""How far faces are apart at most, in metres, how far a peg is off its socket's middle, and how far
askew, in a pair that a person calls plugged together."""


def done(sim: Simulation) -> bool:
    """The light peg is in one socket, the wall's in the other one, and nothing holds them."""
    if not left_alone(sim, LIGHT, DARK):
        return False
    x, y, z = sim.relative_position(DARK, "wall")
    gap = -x - (WALL_PLATE[0] + BAR[0]) / 2
    mounted = -0.001 < gap < SHORT and math.hypot(y, z - PEG_HEIGHT) < 2 * OFF
    x, y, z = sim.relative_position(LIGHT, DARK)
    plugged = -0.001 < abs(x) - BAR[0] < SHORT and math.hypot(y, z) < 2 * OFF
    forwards = sim.rotation(LIGHT)[:, 0]
    along, wall = sim.rotation(DARK)[:, 0], sim.rotation("wall")[:, 0]
    straight = min(abs(float(forwards @ along)), abs(float(along @ wall))) > math.cos(ASKEW)
    points_in = float(forwards @ along) * -x > 0.0
    return mounted and plugged and straight and points_in


def depth(sim: Simulation, peg: str, tip: SE3, mouth: SE3) -> float:
    """How deep a peg's tip is in a socket of the dark block, in metres; below zero beside it."""
    x, y, z = (sim.pose(DARK) @ mouth).inverse().apply((sim.pose(peg) @ tip).translation)
    inside = math.hypot(x, y) < PEG_LENGTH / 4 and -z < SOCKET_DEPTH
    return float(-z) if inside else -1.0


def joined(sim: Simulation) -> bool:
    return max(depth(sim, LIGHT, LIGHT_TIP, mouth) for mouth in (BACK_MOUTH, FRONT_MOUTH)) > DEEP


def on_wall(sim: Simulation) -> bool:
    return depth(sim, "wall", WALL_TIP, FRONT_MOUTH) > DEEP


@dataclass(frozen=True, kw_only=True, slots=True)
class Joining:
    """How the blocks are joined and mounted; the defaults are the expert's way."""

    light: Side = Side.LEFT
    """The arm that has the light block."""
    turned: bool = False
    """Whether the dark block is turned round, so that the other socket takes the light peg."""
    height: float = PEG_HEIGHT
    """Height of the blocks' middle above the table when they are joined, in metres."""
    light_x: float = -0.012
    dark_x: float = 0.0
    """Where along its bar each hand grasps, in metres from the middle."""
    grasp: float = GRASP_HEIGHT
    """Height of the tools above the table when they grasp, in metres."""
    lean: float = math.radians(20.0)
    """How far the hands lean apart, in radians."""
    pushed_from: float | None = None
    """How deep the wall's peg is in its socket, in metres, when both hands let go and a closed one
    pushes on; the hands push all the way where this is None."""


def take(
    arms: Arms, side: Side, block: str, lift: float = 0.06, how: Joining | None = None
) -> Script:
    how = how or Joining()
    along, lean = (how.light_x, how.lean) if block == LIGHT else (how.dark_x, -how.lean)
    pose = arms.sim.pose(block)
    # Whichever end of the dark block is ahead.
    ahead = pose if math.cos(pose.yaw) > 0.0 else pose @ SE3.at(yaw=math.pi)
    x, y, _ = ahead.apply([along, 0.0, 0.0])
    yield from pick(arms, side, down(x, y, how.grasp, yaw=ahead.yaw, tilt=lean), lift=lift)


def lead(
    arms: Arms, goals: dict[Side, tuple[str, SE3]], *, speed: float, correct: bool = False
) -> Script:
    """Move blocks in the hands of sides to poses along straight lines, and there correct what they
    are off.
    """
    tools = {side: tool_for(arms, side, block, pose) for side, (block, pose) in goals.items()}
    yield from move(arms, tools, speed=speed, turn_speed=0.6, tolerance=0.0015)
    for _ in range(3 if correct else 0):
        for side, (block, pose) in goals.items():
            error = pose @ arms.sim.pose(block).inverse()
            arms.targets[side] = error @ arms.targets[side]
        yield from wait(8)


def lead_one(arms: Arms, side: Side, block: str, goal: SE3, speed: float = CAREFUL) -> Script:
    yield from lead(arms, {side: (block, goal)}, speed=speed, correct=speed > SLOW)


def push_in(arms: Arms, side: Side, block: str, goal: SE3) -> Script:
    """Bring a held block in front of its goal, then push it there along its own x."""
    before = goal @ SE3.at(-PEG_LENGTH - BEFORE)
    yield from lead_one(arms, side, block, before.moved(z=0.06))
    yield from lead_one(arms, side, block, before, speed=0.1)
    yield from lead_one(arms, side, block, goal, speed=SLOW)


def let_go(arms: Arms, *sides: Side) -> Script:
    yield from release(arms, *sides)
    away = {side: arms.targets[side] @ SE3.at(z=-RETREAT) for side in sides}
    yield from move(arms, away, speed=CAREFUL)


def mounted(arms: Arms) -> SE3:
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
    yield from to(arms, side, down(0.3, 0.4 * side.sign, 0.3))


def one_after_the_other(arms: Arms, dark: Side, light: Side) -> Script:
    yield from dark_to_wall(arms, dark)
    if dark is not light:
        yield from make_room(arms, dark)
    yield from plug_in_light(arms, light)


def take_both(arms: Arms) -> Script:
    yield from together(take(arms, LEFT, LIGHT, 0.0), take(arms, RIGHT, DARK, 0.0))


def at_the_foot(arms: Arms, side: Side) -> Script:
    """Bring the dark block against the foot of the wall, where it cannot give way."""
    yield from take(arms, side, DARK)
    foot = mounted(arms).moved(z=BAR[2] / 2 - PEG_HEIGHT)
    yield from lead_one(arms, side, DARK, foot.moved(z=0.02))
    yield from lead_one(arms, side, DARK, foot, speed=SLOW)


join_on_table = do((at_the_foot, RIGHT), (let_go, RIGHT), (plug_in_light, RIGHT))


def take_joined(arms: Arms) -> Script:
    yield from join_on_table(arms)
    yield from take(arms, RIGHT, DARK, 0.0)
    yield from to(arms, RIGHT, arms.targets[RIGHT].moved(x=-ROOM), speed=0.1)
    yield from take(arms, LEFT, LIGHT, 0.0)
    goal = mounted(arms)
    before = goal.moved(x=-PEG_LENGTH - BEFORE)
    on_table = before.moved(z=BAR[2] / 2 - PEG_HEIGHT)
    for dark, speed in ((on_table, SLOW), (before, SLOW), (goal, SLOW)):
        light = dark.moved(x=-BAR[0] - TOUCHING)
        yield from lead(arms, {LEFT: (LIGHT, light), RIGHT: (DARK, dark)}, speed=speed)
    yield from let_go(arms, *SIDES)


def plug_in_and_bring(arms: Arms) -> Script:
    """The left arm plugs the light block into the dark one, and brings both to the wall."""
    yield from take(arms, LEFT, LIGHT)
    yield from push_in(arms, LEFT, LIGHT, behind(arms))
    yield from let_go(arms, RIGHT)
    # Raised at its front, the dark block hangs on the peg and does not rub on the table.
    raised = arms.sim.pose(LIGHT).moved(z=RAISE) @ SE3.about((0, 1, 0), -NOSE_UP)
    yield from lead_one(arms, LEFT, LIGHT, raised, speed=SLOW)
    yield from lead_one(arms, LEFT, LIGHT, raised.moved(x=-ROOM), speed=SLOW)
    light = mounted(arms).moved(x=-BAR[0] - TOUCHING)
    yield from lead_one(arms, LEFT, LIGHT, light.moved(x=-PEG_LENGTH - BEFORE), speed=0.1)
    yield from lead_one(arms, LEFT, LIGHT, light, speed=SLOW)
    yield from let_go(arms, LEFT)


def until_joined(arms: Arms) -> Script:
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
    for _ in expert(arms):
        if on_wall(arms.sim) and arms.openings.max() > 0.5:
            break
        yield
    arms.openings[:] = 0.0
    yield from wait(60)


def press(arms: Arms) -> Script:
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


cheat = cheats(done)
ADVERSARIES: dict[str, Way] = {
    "half-open fingers press on both blocks": cheat(
        0, press, deed=fingers_on({LEFT: LIGHT, RIGHT: DARK})
    ),
    "one arm puts the dark block onto the wall and plugs in the light one": cheat(
        0, (one_after_the_other, RIGHT, RIGHT), **ONE
    ),
    "one arm puts the dark block onto the wall, the other plugs in the light one": cheat(
        0, (one_after_the_other, RIGHT, LEFT), **TURNS
    ),
    "both blocks are grasped once, then one arm does the rest": cheat(
        1, take_both, (let_go, *SIDES), (make_room, LEFT), (one_after_the_other, RIGHT, RIGHT)
    ),
    "the blocks are joined on the wall, by both arms": cheat(
        1, (dark_to_wall, RIGHT, {"hold": True}), (plug_in_light, LEFT), (let_go, RIGHT)
    ),
    "one arm joins the blocks on the table, against the wall": cheat(
        0, join_on_table, **ONE, deed=joined
    ),
    "one arm joins the blocks on the table, both bring them to the wall": cheat(1, take_joined),
    "one arm only closes on a block that lies on the table": cheat(
        1, (take, RIGHT, DARK, 0.0), plug_in_and_bring, deed=joined, seed=1
    ),
    "one arm only closes on a block that the wall keeps in its place": cheat(
        1, (at_the_foot, RIGHT), plug_in_and_bring
    ),
    "joined, pulled apart, and put onto the wall one after the other": cheat(2, pull_apart),
    "never lets go of what is on the wall": cheat(
        2, never_let_go, deed=on_wall, lacks="left still touches light_block"
    ),
}

# --- sincere ways ---------------------------------------------------------------------------------

APART, BEFORE_WALL = 0.03, 0.012
"""Gaps in metres of the peg from the socket before an insertion, and of the wall's peg."""
MEETING_X = 0.565
ASIDE_X, FINGERS = 0.42, 0.010
"""Where a block is handed on by the table when the arms change roles, and how far behind a block's
end closed fingertips stop before they push, in metres."""


def join(arms: Arms, how: Joining) -> Script:
    light, dark = how.light, how.light.other
    if how.turned:
        yield from _turn_round(arms, RIGHT)
    if light is RIGHT:
        yield from _change_sides(arms)
    yield from together(take(arms, light, LIGHT, how=how), take(arms, dark, DARK, how=how))

    def blocks(at: SE3, apart: float) -> dict[Side, tuple[str, SE3]]:
        turned = at @ SE3.at(yaw=math.pi) if how.turned else at
        return {light: (LIGHT, at.moved(x=-BAR[0] - apart)), dark: (DARK, turned)}

    meeting = SE3.at(MEETING_X, 0.0, how.height)
    above = max(0.0, PEG_HEIGHT - how.height)
    up = blocks(meeting.moved(z=above), PEG_LENGTH + APART)
    yield from lead(arms, up, speed=CAREFUL, correct=True)
    if above:
        yield from lead(arms, blocks(meeting, PEG_LENGTH + APART), speed=0.1, correct=True)
    yield from lead(arms, {light: blocks(meeting, TOUCHING)[light]}, speed=SLOW)
    goal = mounted(arms)
    before = goal.moved(x=-PEG_LENGTH - BEFORE_WALL)
    short = 0.0 if how.pushed_from is None else PEG_LENGTH - how.pushed_from
    if how.height > PEG_HEIGHT:
        higher = before.moved(z=how.height - PEG_HEIGHT)
        yield from lead(arms, blocks(higher, TOUCHING), speed=CAREFUL)
    yield from lead(arms, blocks(before, TOUCHING), speed=0.10)
    yield from lead(arms, blocks(goal.moved(x=-short), TOUCHING), speed=SLOW)
    yield from let_go(arms, *SIDES)
    if how.pushed_from is not None:
        yield from _push_on(arms, light, short)


def _turn_round(arms: Arms, side: Side) -> Script:
    """Turn the dark block by half a turn, in two goes, as no wrist can in one."""
    for _ in range(2):
        pose = arms.sim.pose(DARK)
        x, y, _ = pose.translation
        yaw = math.remainder(pose.yaw, math.pi)
        yaw = yaw if yaw < math.pi / 4 else yaw - math.pi
        grasp = down(x, y, 0.026, yaw=yaw)
        yield from pick(arms, side, grasp, lift=0.04)
        goal = down(x, y, 0.027, yaw=yaw + math.pi / 2)
        yield from place(arms, side, goal, above=0.04, retreat=0.12)
        # Back the way it came: the shorter way to the next grasp may be beyond the wrist's limit.
        yield from move(arms, {side: down(x, y, 0.15)})


def _change_sides(arms: Arms) -> Script:
    for block, side, y in ((DARK, Side.RIGHT, 0.03), (LIGHT, Side.LEFT, -0.14)):
        pose = arms.sim.pose(block)
        x, y0, _ = pose.translation
        yaw = math.remainder(pose.yaw, math.pi)
        yield from pick(arms, side, down(x, y0, 0.026, yaw=yaw), lift=0.10)
        yield from place(arms, side, down(ASIDE_X, y, 0.027), retreat=0.15)
        yield from move(arms, {side: down(0.42, 0.35 * side.sign, 0.3)}, tolerance=NEAR)


def _push_on(arms: Arms, side: Side, short: float) -> Script:
    """Push the pair on by its end, with closed fingers."""
    yield from grip(arms, side)
    pose = arms.sim.pose(LIGHT)
    x, y, z = pose.apply([-BAR[0] / 2 - FINGERS, 0.0, 0.0])
    behind = down(x, y, z, tilt=0.2) @ SE3.at(yaw=math.pi / 2)
    yield from move(arms, {side: behind.moved(x=-0.06, z=0.10)}, speed=CAREFUL)
    yield from move(arms, {side: behind.moved(x=-0.03)}, speed=CAREFUL)
    yield from move(arms, {side: behind.moved(x=short + FINGERS)}, speed=SLOW)
    yield from wait(10)
    yield from move(arms, {side: behind.moved(x=-0.04)}, speed=CAREFUL)


way = ways_to(join, done, Joining())
LOW = BAR[2] / 2
SINCERE: dict[str, Way] = {
    "the other socket": way(turned=True),
    "the arms change roles": way(light=RIGHT),
    "joined half a millimetre above the table": way(height=LOW + 0.0005),
    "joined 5 mm above the table": way(height=LOW + 0.005),
    "joined 150 mm above the table": way(height=LOW + 0.150),
    "grasped at the far ends": way(light_x=-0.028, dark_x=0.022),
    "grasped at the near ends": way(light_x=-0.002, dark_x=-0.006),
    "the dark block grasped behind": way(light_x=-0.030, dark_x=-0.022),
    "the light block grasped in front": way(light_x=0.015, dark_x=0.022),
    "grasped deep in the fingers": way(grasp=0.021),
    "grasped with the tips": way(grasp=0.031),
    "let go with the tip in the hole and pushed on": way(pushed_from=0.012),
    "trembling": way(tremble=0.01),
    "half the speed": way(slowness=2),
}


def sample(rng: np.random.Generator) -> Way:
    light_x = rng.uniform(-0.030, 0.010)
    height = LOW + rng.uniform(0.0005, 0.150)
    return way(
        light=SIDES[rng.integers(2)],
        turned=bool(rng.random() < 0.4),
        height=height,
        light_x=light_x,
        dark_x=rng.uniform(max(-0.022, light_x + 0.004), 0.022),
        grasp=rng.uniform(0.021, 0.031),
        lean=rng.uniform(0.25, 0.40),
        pushed_from=rng.uniform(0.008, 0.018) if rng.random() < 0.25 else None,
        **random_tempo(rng, trembling=0.15 if height > LOW + 0.01 else 0.0),
    )
