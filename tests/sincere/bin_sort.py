"""Sincere ways in bin_sort: other arms, orders, grasps, heights and places."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from duobench.experts.handling import pick
from duobench.experts.motion import (
    CAREFUL,
    NEAR,
    Arms,
    Script,
    down,
    grip,
    move,
    nearest_turn,
    release,
    together,
)
from duobench.objects.bowl import FLOOR, RADIUS, RIM_HEIGHT, WALL
from duobench.scene.naming import TABLE
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.types import SIDES, Side
from tests.adversaries.bin_sort import drop_and_pinch
from tests.sincere.sincere import Way, left_alone, tilt, ways_to
from tests.steps import do

COLOURS = ("white", "black")
OWN = {"white": Side.LEFT, "black": Side.RIGHT}
MIDDLE = (0.45, 0.0)
"""A place on the table that both arms reach, in metres."""
NEARER = (0.40, 0.02)
"""Where the far bowl is brought before one arm sorts both, on its own side, in metres."""
REACHED = 0.004
"""Distance in metres from a pose that an arm reaches."""
MAX_PICKS = 4
MAX_STANDING_TILT = math.radians(20.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Sorting:
    """How both cubes are sorted."""

    arms: Mapping[str, Side] = field(default_factory=lambda: OWN)
    """The arm that picks up the cube of a colour."""
    order: tuple[str, ...] | None = None
    """Colours in the order in which they are sorted; at the same time where none is given."""
    height: float = 0.028
    """Height of the tool above the table when it grasps, in metres."""
    tilt: float = 0.0
    """How far the gripper leans back when it grasps, in radians."""
    turn: float = 0.0
    """How far the fingers are turned from the cube's sides when they close, in radians."""
    drop: float = 0.010
    """Height of the cube's lowest point above the bowl's floor when it is let go, in metres."""
    place: tuple[float, float] = (0.0, 0.0)
    """Where the cube is let go, from the bowl's middle, in metres."""
    opening: float = 1.0
    """How far the fingers open to let go."""


def sort(arms: Arms, how: Sorting) -> Script:
    """Sort both cubes."""
    if how.order is None:
        yield from together(*(_own(arms, colour, how) for colour in COLOURS))
        return
    for colour in how.order:
        yield from _either(arms, colour, how)


def _own(arms: Arms, colour: str, how: Sorting) -> Script:
    """The arm on a cube's side picks it up and puts it into its bowl."""
    side = OWN[colour]
    hand = _grasp(arms, f"{colour}_cube", how).rotation
    if not _reaches(arms, side, SE3(hand, np.array(_over(arms, colour, how)))):
        how = replace(how, tilt=0.0, turn=0.0, place=(0.0, 0.0))
    yield from _pick(arms, side, f"{colour}_cube", how)
    yield from _put(arms, side, f"{colour}_cube", _over(arms, colour, how), how)


def _either(arms: Arms, colour: str, how: Sorting) -> Script:
    """An arm brings a cube to its bowl, or to the middle, where the other one takes it."""
    cube, side = f"{colour}_cube", how.arms[colour]
    if not _reaches(arms, side, _grasp(arms, cube, how)):
        side = side.other
    yield from _pick(arms, side, cube, how)
    if not _reaches(arms, side, down(*_over(arms, colour, how), tilt=how.tilt)):
        yield from _put(arms, side, cube, (*MIDDLE, 0.0), how)
        yield from _home(arms, side)
        side = side.other
        yield from _pick(arms, side, cube, how)
    yield from _put(arms, side, cube, _over(arms, colour, how), how)
    yield from _home(arms, side)


def by_one(arms: Arms, side: Side) -> Script:
    """One arm sorts both cubes; the other one draws its bowl nearer by the rim before that."""
    how, other = Sorting(), side.other
    far = next(colour for colour in COLOURS if OWN[colour] is other)
    x, y, _ = arms.sim.position(f"{far}_bowl")
    to_rim = other.sign * (RADIUS - WALL / 2)
    rim = down(x, y - to_rim, RIM_HEIGHT)
    yield from pick(arms, other, rim, lift=0.0)
    near = rim.moved(x=NEARER[0] - x, y=NEARER[1] * other.sign - y)
    yield from move(arms, {other: near}, speed=0.2)
    yield from release(arms, other)
    yield from move(arms, {other: near.moved(z=0.1)})
    yield from _home(arms, other)
    for colour in (far, *(colour for colour in COLOURS if colour != far)):
        yield from _pick(arms, side, f"{colour}_cube", how)
        yield from _put(arms, side, f"{colour}_cube", _over(arms, colour, how), how)


def _over(arms: Arms, colour: str, how: Sorting) -> tuple[float, float, float]:
    """Where the lowest point of a cube is let go."""
    x, y, z = arms.sim.position(f"{colour}_bowl")
    return x + how.place[0], y + how.place[1], z + FLOOR + how.drop


def _grasp(arms: Arms, cube: str, how: Sorting) -> SE3:
    pose = arms.sim.pose(cube)
    x, y, _ = pose.translation
    yaw = nearest_turn(pose.yaw, math.pi / 2) + how.turn
    return down(x, y, how.height, yaw=yaw, tilt=how.tilt)


def _pick(arms: Arms, side: Side, cube: str, how: Sorting) -> Script:
    for _ in range(MAX_PICKS):
        if arms.grasps(side, cube):
            return
        yield from pick(arms, side, _grasp(arms, cube, how))


def _put(
    arms: Arms,
    side: Side,
    cube: str,
    low: tuple[float, float, float],
    how: Sorting,
    *,
    again: bool = True,
) -> Script:
    """Bring a held cube so that its lowest point is over a place, at a height; let go of it.

    A cube that has slipped out of the hand on the way is picked up again.
    """
    x, y, z = low
    tool = arms.targets[side]
    offset = arms.sim.position(cube) - arms.tcp_pose(side).translation
    goal = SE3(tool.rotation, np.array([x - offset[0], y - offset[1], tool.translation[2]]))
    yield from move(arms, {side: goal}, tolerance=NEAR)
    below = arms.tcp_pose(side).translation[2] - arms.sim.min_height(cube)
    goal = SE3(goal.rotation, np.array([*goal.translation[:2], z + below]))
    yield from move(arms, {side: goal}, speed=CAREFUL)
    if again and not arms.grasps(side, cube):
        yield from _pick(arms, side, cube, Sorting())
        yield from _put(arms, side, cube, low, Sorting(), again=False)
        return
    yield from release(arms, side, opening=how.opening)
    yield from move(arms, {side: goal.moved(z=0.1)}, arrive=False)


def _home(arms: Arms, side: Side) -> Script:
    """Make room for the other arm."""
    yield from move(arms, {side: down(MIDDLE[0], 0.3 * side.sign, 0.3)}, tolerance=NEAR)
    yield from grip(arms, side, opening=1.0)


def _reaches(arms: Arms, side: Side, tool: SE3) -> bool:
    """Whether inverse kinematics brings a tool to a pose."""
    joints = arms.joints
    for _ in range(90):
        joints = arms.kinematics.step(joints, {side: tool})
    return arms.kinematics.forward(joints)[side].distance(tool)[0] < REACHED


def done(sim: Simulation) -> bool:
    """Each cube lies in the bowl of its colour, let go, and the bowls stand on the table."""
    for colour in COLOURS:
        cube, bowl = f"{colour}_cube", f"{colour}_bowl"
        x, y, z = sim.relative_position(cube, bowl)
        lies = math.hypot(x, y) < RADIUS - WALL and 0.0 < z < RIM_HEIGHT
        lies = lies and sim.contacts.between(cube, bowl) and left_alone(sim, cube)
        stands = sim.contacts.between(bowl, TABLE) and tilt(sim, bowl) < MAX_STANDING_TILT
        if not (lies and stands):
            return False
    return True


way = ways_to(sort, done, Sorting())


CROSSED = {colour: side.other for colour, side in OWN.items()}
WAYS: tuple[Way, ...] = (
    way("one after the other", Sorting(order=("white", "black"))),
    way("one after the other, the black cube first", Sorting(order=("black", "white"))),
    way("each cube by the arm of the other side", Sorting(order=COLOURS, arms=CROSSED)),
    *(way(f"the {side} arm sorts both", script=do((by_one, side))) for side in SIDES),
    way("let go at the rim's height", Sorting(drop=RIM_HEIGHT - FLOOR)),
    *(
        way(f"let go {1000 * high:.0f} mm above the rim", Sorting(drop=RIM_HEIGHT - FLOOR + high))
        for high in (0.015, 0.030, 0.050)
    ),
    way(
        "cubes that slipped into the bowls are lifted and laid down",
        script=do((drop_and_pinch, 0.02)),
    ),
    way("let go on the floor", Sorting(drop=0.0)),
    way("pressed into the bowl", Sorting(drop=-0.004)),
    way("let go beside the rim", Sorting(place=(-0.045, 0.0), drop=0.02, opening=0.6)),
    way("grasped deep in the fingers", Sorting(height=0.018)),
    way("grasped with the tips", Sorting(height=0.037)),
    way("grasped by two edges", Sorting(turn=math.pi / 4)),
    way("hands that lean", Sorting(tilt=0.4)),
    way("trembling", tremble=0.01),
    way("half the speed", slowness=2),
)


def sample(rng: np.random.Generator) -> Way:
    """A way at random."""
    tremble, slowness = (0.01 if rng.random() < 0.2 else 0.0), (2 if rng.random() < 0.2 else 1)
    turn = rng.uniform(-0.8, 0.8) if rng.random() < 0.5 and tremble == 0.0 else 0.0
    how = Sorting(
        # A cube that turns deep in the fingers, or at their tips, may slip out of them.
        height=rng.uniform(0.018, 0.036) if turn == 0.0 else rng.uniform(0.022, 0.033),
        # Leaning and turned, a hand does not reach the bowls that are far away.
        tilt=rng.uniform(-0.3, 0.35) * (1.0 if turn == 0.0 else 0.4),
        turn=turn,
        drop=rng.uniform(-0.004, RIM_HEIGHT - FLOOR + 0.05),
        opening=rng.uniform(0.6, 1.0),
    )
    angle, reach = rng.uniform(0.0, 2 * math.pi), rng.uniform(0.0, 0.045)
    how = replace(how, place=(reach * math.cos(angle), reach * math.sin(angle)))
    if rng.random() < 0.6:
        order = COLOURS if rng.random() < 0.5 else COLOURS[::-1]
        chosen = {colour: SIDES[rng.integers(2)] for colour in COLOURS}
        how = replace(how, order=order, arms=chosen)
    return way(how=how, tremble=tremble, slowness=slowness)
