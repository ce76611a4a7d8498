"""How one might cheat in bin_sort: a cube that is in its bowl for a moment, or in none."""

from __future__ import annotations

import math

from duobench.experts.handling import pick, pick_cube, place
from duobench.experts.motion import (
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
from duobench.objects.bowl import RADIUS, RIM_HEIGHT, WALL
from duobench.scene.naming import TABLE
from duobench.sim.simulation import Simulation
from duobench.stages.predicates import STILL_SPEED
from duobench.types import CONTROL_HZ, SIDES, Side
from tests.adversaries.adversary import ONE, Adversary, cheats
from tests.steps import to

GRASP_HEIGHT, DROP_HEIGHT = 0.028, 0.045
"""Heights of the tool in metres: grasping a cube on the table, letting go of it in a bowl."""
RUN_UP, THROW_HEIGHT, THROW_SECONDS = 0.21, 0.175, 0.24
"""Way in metres, height in metres and duration in seconds of the swing that throws."""
DROPS = (0.15, 0.25)
"""How far above the rim a cube's lowest point is when it is dropped, in metres."""
BOWL_LIFT = 0.10
MIDDLE = (0.45, 0.05)
"""A place on the table that both arms reach, in metres."""


def in_bowl(sim: Simulation, cube: str, bowl: str) -> bool:
    """The cube is let go, inside the bowl and in contact with it, wherever the bowl is."""
    x, y, z = sim.relative_position(cube, bowl)
    inside = x * x + y * y < (RADIUS - WALL) ** 2 and 0.0 < z < RIM_HEIGHT
    held = any(sim.contacts.gripper(side, cube) for side in SIDES)
    return inside and not held and sim.contacts.between(cube, bowl)


def throw(arms: Arms) -> Script:
    """Fling the white cube into the white bowl, so that it bounces out again."""
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
    """The white cube is laid across its bowl's rim and pushed in by closed fingers."""
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
    """Put each cube into the bowl of the other colour; no arm reaches the bowl on the far side."""
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


def both_in(sim: Simulation) -> bool:
    """Both lie in their bowls, at rest."""
    return all(
        in_bowl(sim, f"{colour}_cube", f"{colour}_bowl")
        and sim.speed(f"{colour}_cube")[0] < STILL_SPEED / 10
        for colour in ("white", "black")
    )


def lying(sim: Simulation) -> bool:
    slow = sim.speed("white_cube")[0] < STILL_SPEED / 10
    return slow and in_bowl(sim, "white_cube", "white_bowl")


def flying(sim: Simulation) -> bool:
    fast = sim.speed("white_cube")[0] > STILL_SPEED
    return fast and in_bowl(sim, "white_cube", "white_bowl")


cheat = cheats(both_in)
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("a thrown cube touches its bowl in flight", 1, throw, **ONE, deed=flying, seed=1),
    *(
        cheat(
            f"both cubes are dropped from {1000 * height:.0f} mm above the rims",
            2,
            (drop, height),
            lacks="_cube go: ",
        )
        for height in DROPS
    ),
    cheat(
        "both cubes are dropped from above the rims, and grasped where they lie", 2, drop_and_pinch
    ),
    cheat(
        "a cube is pushed from the rim into its bowl", 1, push_in_from_the_rim, **ONE, deed=lying
    ),
    cheat("each cube lies in the other's bowl", 1, swap, deed=swapped),
    cheat(
        "a cube lies in its bowl, which an arm holds in the air",
        1,
        lifted_bowl,
        deed=in_the_air,
        lacks="white_bowl does not touch table",
    ),
)
