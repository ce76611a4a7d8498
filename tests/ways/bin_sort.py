"""Ways to sort two cubes into two bowls, and to seem to: a cube is in its bowl for a moment, or in
none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.tasks.experts.handling import pick, pick_cube, place
from duobench.tasks.experts.motion import (
    CAREFUL,
    NEAR,
    OPEN,
    Arms,
    Script,
    down,
    follow,
    grip,
    move,
    nearest_turn,
    release,
    together,
)
from duobench.tasks.stages.predicates import STILL_SPEED
from duobench.world.objects.bowl import FLOOR, RADIUS, RIM_HEIGHT, WALL
from duobench.world.scene.naming import TABLE
from duobench.world.sim.simulation import Simulation
from tests.steps import do, to
from tests.ways.way import ONE, Way, cheats, left_alone, random_tempo, tilt, ways_to

MAX_STANDING_TILT = math.radians(20.0)
COLOURS = ("white", "black")
OWN = {"white": Side.LEFT, "black": Side.RIGHT}
GRASP_HEIGHT, DROP_HEIGHT = 0.028, 0.045
"""Heights of the tool in metres: grasping a cube on the table, letting go of it in a bowl."""
RUN_UP, THROW_HEIGHT, THROW_SECONDS = 0.21, 0.175, 0.24
"""Way in metres, height in metres and duration in seconds of the swing that throws."""
DROPS = (0.15, 0.25)
"""How far above the rim a cube's lowest point is when it is dropped, in metres."""
BOWL_LIFT = 0.10
MIDDLE = (0.45, 0.05)
"""A place on the table that both arms reach, in metres."""


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


def in_bowl(sim: Simulation, cube: str, bowl: str) -> bool:
    """The cube is let go, inside the bowl and in contact with it, wherever the bowl is."""
    x, y, z = sim.relative_position(cube, bowl)
    inside = x * x + y * y < (RADIUS - WALL) ** 2 and 0.0 < z < RIM_HEIGHT
    held = any(sim.contacts.gripper(side, cube) for side in SIDES)
    return inside and not held and sim.contacts.between(cube, bowl)


def throw(arms: Arms) -> Script:
    yield from pick_cube(arms, Side.LEFT, "white_cube", GRASP_HEIGHT)
    x, y, _ = arms.sim.position("white_bowl")
    start, end = down(x, y - RUN_UP, THROW_HEIGHT), down(x, y, THROW_HEIGHT)
    yield from to(arms, Side.LEFT, start)
    swing = follow(arms, lambda f: {Side.LEFT: start.interpolate(end, f)}, THROW_SECONDS)
    for number, _ in enumerate(swing):
        if number >= THROW_SECONDS * CONTROL_HZ / 2:
            arms.openings[Side.LEFT.index] = OPEN
        yield


def drop(arms: Arms, height: float) -> Script:
    """Let both cubes fall into their bowls, from a height above the rims in metres."""
    hands = ((Side.LEFT, "white"), (Side.RIGHT, "black"))
    yield from together(*(_drop(arms, side, f"{c}_cube", f"{c}_bowl", height) for side, c in hands))


def _drop(arms: Arms, side: Side, cube: str, bowl: str, height: float) -> Script:
    yield from pick_cube(arms, side, cube, GRASP_HEIGHT)
    x, y, _ = arms.sim.position(bowl)
    below = arms.targets[side].translation[2] - arms.sim.min_height(cube)
    above = down(x, y, RIM_HEIGHT + height + below)
    yield from to(arms, side, above.moved(z=0.05))
    yield from to(arms, side, above, speed=0.1)
    yield from release(arms, side)
    yield from to(arms, side, above.moved(z=0.1), arrive=False)


def drop_and_pinch(arms: Arms, lift: float = 0.0) -> Script:
    """The same; then each is grasped where it lies, lifted by `lift` metres, and let go there."""
    yield from drop(arms, DROPS[0])
    sides = {"white_cube": Side.LEFT, "black_cube": Side.RIGHT}
    tools = {}
    for cube, side in sides.items():
        pose = arms.sim.pose(cube)
        x, y, _ = pose.translation
        tools[side] = down(x, y, DROP_HEIGHT - 0.011, yaw=nearest_turn(pose.yaw, math.pi / 2))
    above = {side: tool.moved(z=0.10) for side, tool in tools.items()}
    yield from move(arms, above)
    yield from move(arms, tools, speed=0.1)
    yield from grip(arms, *sides.values())
    for way in (lift, 0.0) if lift else ():
        lifted = {side: tool.moved(z=way) for side, tool in tools.items()}
        yield from move(arms, lifted, speed=0.1)
    yield from release(arms, *sides.values())
    yield from move(arms, above, speed=0.3)


def push_in_from_the_rim(arms: Arms) -> Script:
    yield from pick_cube(arms, Side.LEFT, "white_cube", GRASP_HEIGHT)
    x, y, _ = arms.sim.position("white_bowl")
    ledge = down(x, y - RADIUS + WALL / 2, RIM_HEIGHT + GRASP_HEIGHT)
    yield from to(arms, Side.LEFT, ledge.moved(z=0.05))
    yield from to(arms, Side.LEFT, ledge, speed=0.1)
    yield from release(arms, Side.LEFT)
    yield from to(arms, Side.LEFT, ledge.moved(z=0.1))
    yield from grip(arms, Side.LEFT)
    behind = ledge.moved(y=-0.05, z=0.005)
    yield from to(arms, Side.LEFT, behind.moved(z=0.1))
    yield from to(arms, Side.LEFT, behind, speed=0.1)
    yield from to(arms, Side.LEFT, behind.moved(y=0.06), speed=0.1)
    yield from to(arms, Side.LEFT, behind.moved(y=0.06, z=0.1))


def swap(arms: Arms) -> Script:
    for giver, cube, bowl in (
        (Side.LEFT, "white_cube", "black_bowl"),
        (Side.RIGHT, "black_cube", "white_bowl"),
    ):
        for side, (x, y, _), z in (
            (giver, (*MIDDLE, 0.0), GRASP_HEIGHT),
            (giver.other, arms.sim.position(bowl), DROP_HEIGHT),
        ):
            yield from pick_cube(arms, side, cube, GRASP_HEIGHT)
            yield from place(arms, side, down(x, y, z))
            yield from to(arms, side, down(MIDDLE[0], 0.3 * side.sign, 0.3), arrive=False)


def swapped(sim: Simulation) -> bool:
    return in_bowl(sim, "white_cube", "black_bowl") and in_bowl(sim, "black_cube", "white_bowl")


def lifted_bowl(arms: Arms) -> Script:
    """One arm holds the white bowl in the air by its rim; the other one puts the white cube in."""
    yield from pick_cube(arms, Side.RIGHT, "white_cube", GRASP_HEIGHT)
    yield from to(arms, Side.RIGHT, down(MIDDLE[0], -0.2, 0.25))
    x, y, _ = arms.sim.position("white_bowl")
    rim = RADIUS - WALL / 2
    yield from pick(arms, Side.LEFT, down(x, y + rim, RIM_HEIGHT), lift=BOWL_LIFT)
    over = down(*MIDDLE, BOWL_LIFT).moved(y=rim)
    yield from to(arms, Side.LEFT, over)
    x, y, z = arms.sim.position("white_bowl")
    yield from place(arms, Side.RIGHT, down(x, y - rim / 3, z + DROP_HEIGHT), above=0.12)


def in_the_air(sim: Simulation) -> bool:
    standing = sim.contacts.between("white_bowl", TABLE)
    return in_bowl(sim, "white_cube", "white_bowl") and not standing


def lying(sim: Simulation) -> bool:
    slow = sim.speed("white_cube")[0] < STILL_SPEED / 10
    return slow and in_bowl(sim, "white_cube", "white_bowl")


def flying(sim: Simulation) -> bool:
    fast = sim.speed("white_cube")[0] > STILL_SPEED
    return fast and in_bowl(sim, "white_cube", "white_bowl")


cheat = cheats(done)
ADVERSARIES: dict[str, Way] = {
    "a thrown cube touches its bowl in flight": cheat(1, throw, **ONE, deed=flying, seed=1),
    **{
        f"both cubes are dropped from {1000 * height:.0f} mm above the rims": cheat(
            2, (drop, height), lacks="_cube go: "
        )
        for height in DROPS
    },
    "both cubes are dropped from above the rims, and grasped where they lie": cheat(
        2, drop_and_pinch
    ),
    "a cube is pushed from the rim into its bowl": cheat(
        1, push_in_from_the_rim, **ONE, deed=lying
    ),
    "each cube lies in the other's bowl": cheat(1, swap, deed=swapped),
    "a cube lies in its bowl, which an arm holds in the air": cheat(
        1, lifted_bowl, deed=in_the_air, lacks="white_bowl does not touch table"
    ),
}

# --- sincere ways ---------------------------------------------------------------------------------

CENTRE = (0.45, 0.0)
"""Where one arm lays a cube down for the other one, in metres."""
NEARER = (0.40, 0.02)
"""Where the far bowl is brought before one arm sorts both, on its own side, in metres."""
REACHED = 0.004
"""Distance in metres from a pose that an arm reaches."""
MAX_PICKS = 4


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
    if how.order is None:
        yield from together(*(_own(arms, colour, how) for colour in COLOURS))
        return
    for colour in how.order:
        yield from _either(arms, colour, how)


def _own(arms: Arms, colour: str, how: Sorting) -> Script:
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
        yield from _put(arms, side, cube, (*CENTRE, 0.0), how)
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
    yield from move(arms, {side: down(CENTRE[0], 0.3 * side.sign, 0.3)}, tolerance=NEAR)
    yield from grip(arms, side, opening=1.0)


def _reaches(arms: Arms, side: Side, tool: SE3) -> bool:
    """Whether inverse kinematics brings a tool to a pose."""
    joints = arms.joints
    for _ in range(90):
        joints = arms.kinematics.step(joints, {side: tool})
    return arms.kinematics.forward(joints)[side].distance(tool)[0] < REACHED


way = ways_to(sort, done, Sorting())
RIM = RIM_HEIGHT - FLOOR
SINCERE: dict[str, Way] = {
    "one after the other": way(order=COLOURS),
    "one after the other, the black cube first": way(order=COLOURS[::-1]),
    "each cube by the arm of the other side": way(
        order=COLOURS, arms={colour: side.other for colour, side in OWN.items()}
    ),
    **{f"the {side} arm sorts both": way(script=do((by_one, side))) for side in SIDES},
    "let go at the rim's height": way(drop=RIM),
    **{
        f"let go {1000 * high:.0f} mm above the rim": way(drop=RIM + high)
        for high in (0.015, 0.030, 0.050)
    },
    "cubes that slipped into the bowls are lifted and laid down": way(
        script=do((drop_and_pinch, 0.02))
    ),
    "let go on the floor": way(drop=0.0),
    "pressed into the bowl": way(drop=-0.004),
    "let go beside the rim": way(place=(-0.045, 0.0), drop=0.02, opening=0.6),
    "grasped deep in the fingers": way(height=0.018),
    "grasped with the tips": way(height=0.037),
    "grasped by two edges": way(turn=math.pi / 4),
    "hands that lean": way(tilt=0.4),
    "trembling": way(tremble=0.01),
    "half the speed": way(slowness=2),
}


def sample(rng: np.random.Generator) -> Way:
    tempo = random_tempo(rng, slowly=0.2, trembling=0.2)
    turn = rng.uniform(-0.8, 0.8) if rng.random() < 0.5 and tempo["tremble"] == 0.0 else 0.0
    angle, reach = rng.uniform(0.0, 2 * math.pi), rng.uniform(0.0, 0.045)
    how = Sorting(
        # A cube that turns deep in the fingers, or at their tips, may slip out of them.
        height=rng.uniform(0.018, 0.036) if turn == 0.0 else rng.uniform(0.022, 0.033),
        # Leaning and turned, a hand does not reach the bowls that are far away.
        tilt=rng.uniform(-0.3, 0.35) * (1.0 if turn == 0.0 else 0.4),
        turn=turn,
        drop=rng.uniform(-0.004, RIM + 0.05),
        place=(reach * math.cos(angle), reach * math.sin(angle)),
        opening=rng.uniform(0.6, 1.0),
    )
    if rng.random() < 0.6:
        order = COLOURS if rng.random() < 0.5 else COLOURS[::-1]
        chosen = {colour: SIDES[rng.integers(2)] for colour in COLOURS}
        how = replace(how, order=order, arms=chosen)
    return way(how, **tempo)
