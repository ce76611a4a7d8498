"""Sincere ways in join_blocks: other sockets, places, grasps, hands, and ways to push."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from duobench.experts.handling import pick, place, tool_for
from duobench.experts.motion import (
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
from duobench.objects.joint_blocks import BAR, PEG_HEIGHT, PEG_LENGTH, WALL_PLATE
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.types import SIDES, Side
from tests.sincere.sincere import Way, left_alone, ways_to

LIGHT, DARK = "light_block", "dark_block"
APART, BEFORE_WALL, TOUCHING = 0.03, 0.012, 0.0005
"""Gaps in metres: of the peg from the socket before an insertion, of the wall's peg, of faces that
meet."""
MEETING_X = 0.565
SLOW = 0.05
RETREAT = 0.10
ASIDE_X = 0.42
"""Where a block is handed on by the table when the arms change roles, in metres."""
FINGERS = 0.010
"""How far behind a block's end closed fingertips stop before they push, in metres."""
SHORT, OFF, ASKEW = 0.014, 0.005, math.radians(12.0)
"""How far faces are apart at most, in metres, how far a peg is off its socket's middle, and how far
askew, in a pair that a person calls plugged together."""


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
    grasp: float = 0.026
    """Height of the tools above the table when they grasp, in metres."""
    lean: float = math.radians(20.0)
    """How far the hands lean apart, in radians."""
    pushed_from: float | None = None
    """How deep the wall's peg is in its socket, in metres, when both hands let go and a closed one
    pushes on; the hands push all the way where this is None."""


def join(arms: Arms, how: Joining) -> Script:
    """Join the blocks in the air, push them onto the wall, let go."""
    sides = {LIGHT: how.light, DARK: how.light.other}
    if how.turned:
        yield from _turn_round(arms, Side.RIGHT)
    if how.light is Side.RIGHT:
        yield from _change_sides(arms)
    yield from together(*(_take(arms, side, block, how) for block, side in sides.items()))
    turn = SE3.at(yaw=math.pi) if how.turned else SE3()
    dark = SE3.at(MEETING_X, 0.0, how.height)
    light = dark.moved(x=-BAR[0] - PEG_LENGTH - APART)
    above = max(0.0, PEG_HEIGHT - how.height)
    poses = {DARK: dark @ turn, LIGHT: light}
    up = {block: pose.moved(z=above) for block, pose in poses.items()}
    yield from _lead(arms, sides, up, speed=CAREFUL)
    yield from _correct(arms, sides, up)
    if above:
        yield from _lead(arms, sides, poses, speed=0.1)
        yield from _correct(arms, sides, poses)
    yield from _lead(arms, sides, {LIGHT: dark.moved(x=-BAR[0] - TOUCHING)}, speed=SLOW)
    on_wall = arms.sim.pose("wall") @ SE3.at(-(WALL_PLATE[0] + BAR[0]) / 2 - TOUCHING)
    on_wall = on_wall.moved(z=PEG_HEIGHT)
    before = on_wall.moved(x=-PEG_LENGTH - BEFORE_WALL)
    short = 0.0 if how.pushed_from is None else PEG_LENGTH - how.pushed_from
    goals = [(before, 0.10), (on_wall.moved(x=-short), SLOW)]
    if how.height > PEG_HEIGHT:
        goals.insert(0, (before.moved(z=how.height - PEG_HEIGHT), CAREFUL))
    for goal, speed in goals:
        both = {DARK: goal @ turn, LIGHT: goal.moved(x=-BAR[0] - TOUCHING)}
        yield from _lead(arms, sides, both, speed=speed)
    yield from _leave(arms, *SIDES)
    if how.pushed_from is not None:
        yield from _push_on(arms, how.light, short)


def _take(arms: Arms, side: Side, block: str, how: Joining) -> Script:
    along = how.light_x if block == LIGHT else how.dark_x
    lean = how.lean if block == LIGHT else -how.lean
    pose = arms.sim.pose(block)
    # Whichever end of the dark block is ahead.
    ahead = pose if math.cos(pose.yaw) > 0.0 else pose @ SE3.at(yaw=math.pi)
    x, y, _ = ahead.apply([along, 0.0, 0.0])
    grasp = down(x, y, how.grasp, yaw=ahead.yaw, tilt=lean)
    yield from pick(arms, side, grasp, above=0.10, lift=0.06)


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
    """Each arm hands its block to the other one by the table."""
    for block, side, y in ((DARK, Side.RIGHT, 0.03), (LIGHT, Side.LEFT, -0.14)):
        pose = arms.sim.pose(block)
        x, y0, _ = pose.translation
        yaw = math.remainder(pose.yaw, math.pi)
        yield from pick(arms, side, down(x, y0, 0.026, yaw=yaw), lift=0.10)
        yield from place(arms, side, down(ASIDE_X, y, 0.027), retreat=0.15)
        yield from move(arms, {side: down(0.42, 0.35 * side.sign, 0.3)}, tolerance=NEAR)


def _lead(arms: Arms, sides: dict[str, Side], blocks: dict[str, SE3], *, speed: float) -> Script:
    """Move held blocks to poses along straight lines."""
    goals = {
        sides[block]: tool_for(arms, sides[block], block, pose) for block, pose in blocks.items()
    }
    yield from move(arms, goals, speed=speed, turn_speed=0.6, tolerance=0.0015)


def _correct(arms: Arms, sides: dict[str, Side], blocks: dict[str, SE3]) -> Script:
    """Shift the tools by what their blocks are still off."""
    for _ in range(3):
        for block, pose in blocks.items():
            error = pose @ arms.sim.pose(block).inverse()
            arms.targets[sides[block]] = error @ arms.targets[sides[block]]
        yield from wait(8)


def _leave(arms: Arms, *sides: Side) -> Script:
    yield from release(arms, *sides)
    away = {side: arms.targets[side] @ SE3.at(z=-RETREAT) for side in sides}
    yield from move(arms, away, speed=CAREFUL)


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


way = ways_to(join, done, Joining())


LOW = BAR[2] / 2
WAYS: tuple[Way, ...] = (
    way("the other socket", Joining(turned=True)),
    way("the arms change roles", Joining(light=Side.RIGHT)),
    way("joined half a millimetre above the table", Joining(height=LOW + 0.0005)),
    way("joined 5 mm above the table", Joining(height=LOW + 0.005)),
    way("joined 150 mm above the table", Joining(height=LOW + 0.150)),
    way("grasped at the far ends", Joining(light_x=-0.028, dark_x=0.022)),
    way("grasped at the near ends", Joining(light_x=-0.002, dark_x=-0.006)),
    way("the dark block grasped behind", Joining(light_x=-0.030, dark_x=-0.022)),
    way("the light block grasped in front", Joining(light_x=0.015, dark_x=0.022)),
    way("grasped deep in the fingers", Joining(grasp=0.021)),
    way("grasped with the tips", Joining(grasp=0.031)),
    way("let go with the tip in the hole and pushed on", Joining(pushed_from=0.012)),
    way("trembling", tremble=0.01),
    way("half the speed", slowness=2),
)


def sample(rng: np.random.Generator) -> Way:
    """A way at random."""
    light_x = rng.uniform(-0.030, 0.010)
    how = Joining(
        light=SIDES[rng.integers(2)],
        turned=bool(rng.random() < 0.4),
        height=LOW + rng.uniform(0.0005, 0.150),
        light_x=light_x,
        dark_x=rng.uniform(max(-0.022, light_x + 0.004), 0.022),
        grasp=rng.uniform(0.021, 0.031),
        lean=rng.uniform(0.25, 0.40),
        pushed_from=rng.uniform(0.008, 0.018) if rng.random() < 0.25 else None,
    )
    tremble = 0.01 if rng.random() < 0.15 and how.height > LOW + 0.01 else 0.0
    return way(how=how, tremble=tremble, slowness=2 if rng.random() < 0.15 else 1)
