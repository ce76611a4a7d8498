"""How one might cheat in pour_marbles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from duobench.experts.handling import pick, place, tool_for
from duobench.experts.motion import Arms, Script, down, move, together, wait
from duobench.experts.scripts.pour_marbles import (
    HOLD_TILT,
    POUR_TILT,
    bring_back,
    pour,
    put_back,
    script,
    square,
    take,
    turn_upright,
)
from duobench.objects.cup import HEIGHT, INNER_RADIUS, WALL
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.pour_marbles import CUPS, MARBLES
from duobench.types import SIDES, Side
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.sincere.pour_marbles import Pouring, done, push_home
from tests.steps import to

MIDDLE = SE3.at(0.5, 0.0)
"""Where a cup stands between the squares."""
TURN_STEPS, BACK = 60, 4
"""Control steps in which the pouring cup turns, and how many of them it goes back in one."""
NEARBY = 0.06
"""How far from there, in metres, a cup is still in the middle; the pouring one is farther away."""
MOST = 15
"""How many marbles are enough for a deed: one that falls beside the cup is no matter."""


def in_cup(sim: Simulation, side: Side) -> int:
    """How many marbles are near a cup's middle."""
    offsets = np.array([sim.relative_position(marble, CUPS[side]) for marble in MARBLES])
    return int((np.linalg.norm(offsets, axis=1) < HEIGHT / 2).sum())


def out_of(sim: Simulation, side: Side) -> int:
    """How many marbles are above a cup's rim, as the cup sees it."""
    return sum(sim.relative_position(marble, CUPS[side])[2] > HEIGHT for marble in MARBLES)


def full(sim: Simulation) -> Side:
    """The side whose cup holds the most marbles: at the start the source, at the end the target."""
    return max(SIDES, key=lambda side: in_cup(sim, side))


def stands(sim: Simulation, side: Side) -> bool:
    """Whether a cup is on the table."""
    return sim.contacts.between(CUPS[side], "table")


def home(arms: Arms, side: Side) -> Script:
    """Bring an empty gripper out of the way of the other one."""
    x, _, z = arms.targets[side].translation
    yield from to(arms, side, down(x - 0.1, side.sign * 0.4, z + 0.15))


def take_both(arms: Arms, source: Side) -> Script:
    """Grasp both cups and lift them by a few centimetres."""
    other = take(arms, source.other, tilt=HOLD_TILT)
    yield from together(other, take(arms, source, tilt=POUR_TILT))


def pour_alone(arms: Arms) -> Script:
    """One arm brings both cups together and pours: the other cup it carries by its rim."""
    side = full(arms.sim)
    x, y, _ = arms.sim.position(CUPS[side.other])
    rim = down(x, y + side.sign * (INNER_RADIUS + WALL / 2), HEIGHT - 0.008)
    yield from pick(arms, side, rim)
    yield from place(arms, side, rim.moved(x=MIDDLE.translation[0] - x, y=-y))
    yield from home(arms, side)
    yield from take(arms, side)
    yield from pour(arms, side, arms.sim.pose(CUPS[side.other]))
    yield from bring_back(arms, side)


def pour_in_turns(arms: Arms) -> Script:
    """One arm sets its cup down in the middle; only then the other one comes and pours."""
    side = full(arms.sim)
    yield from take(arms, side.other)
    yield from put_back(arms, side.other, MIDDLE)
    yield from home(arms, side.other)
    yield from take(arms, side)
    yield from pour(arms, side, arms.sim.pose(CUPS[side.other]))
    yield from bring_back(arms, side)
    yield from home(arms, side)
    yield from take(arms, side.other)
    yield from put_back(arms, side.other, square(arms, side.other))


def lift_once_then_pour_alone(arms: Arms) -> Script:
    """Both cups are lifted once; then the target stands, let go, and one arm pours."""
    side = full(arms.sim)
    yield from take_both(arms, side)
    yield from put_back(arms, side.other, MIDDLE)
    yield from home(arms, side.other)
    yield from pour(arms, side, arms.sim.pose(CUPS[side.other]))
    yield from bring_back(arms, side)


def pour_into_a_cup_on_the_table(arms: Arms) -> Script:
    """The target stands in its arm's gripper while marbles fall in, and is lifted with them."""
    side = full(arms.sim)
    other = side.other
    yield from take_both(arms, side)
    low = tool_for(arms, other, CUPS[other], MIDDLE)
    yield from to(arms, other, low.moved(z=0.08), speed=0.3)
    yield from to(arms, other, low.moved(z=-0.002), speed=0.2)
    yield from pour(arms, side, arms.sim.pose(CUPS[other]))
    yield from turn_upright(arms, side)
    yield from to(arms, other, low.moved(z=0.08), speed=0.2)
    yield from together(*(put_back(arms, s, square(arms, s)) for s in SIDES))


def pour_the_rest_alone(arms: Arms) -> Script:
    """A few marbles are poured in the air, the rest by one arm into a cup that stands."""
    side = full(arms.sim)
    other = side.other
    way = []
    for _ in script(arms):
        way.append(arms.targets[side])
        yield
        if out_of(arms.sim, side) > 0:
            break
    for pose in way[:-TURN_STEPS:-BACK]:
        arms.targets[side] = pose
        yield
    yield from wait(20)
    yield from put_back(arms, other, MIDDLE)
    yield from home(arms, other)
    yield from pour(arms, side, arms.sim.pose(CUPS[other]))
    yield from turn_upright(arms, side)
    yield from take(arms, other, tilt=HOLD_TILT)
    yield from together(*(put_back(arms, s, square(arms, s)) for s in SIDES))


def press_half_open_fingers(arms: Arms) -> Script:
    """Half-open fingers press on the rims of both cups."""
    arms.openings[:] = 0.5
    above = {s: down(*arms.sim.position(CUPS[s])[:2], HEIGHT + 0.05) for s in SIDES}
    yield from move(arms, above)
    yield from move(arms, {s: pose.moved(z=-0.065) for s, pose in above.items()}, speed=0.1)
    yield from wait(20)


def back_at_home(sim: Simulation) -> bool:
    """Both cups stand upright on their squares, let go, one of them with all marbles."""
    return any(done(sim, side) for side in SIDES)


def in_the_middle(*, on_table: bool) -> Callable[[Simulation], bool]:
    """Most marbles are in a cup between the squares, which stands on the table or does not."""

    def holds(sim: Simulation) -> bool:
        side = full(sim)
        away = sim.position(CUPS[side])[:2] - MIDDLE.translation[:2]
        there = np.hypot(*away) < NEARBY and stands(sim, side) == on_table
        return bool(there) and in_cup(sim, side) >= MOST

    return holds


def pressed(sim: Simulation) -> bool:
    """Each gripper touches the cup of its side."""
    return all(sim.contacts.gripper(side, CUPS[side]) for side in SIDES)


cheat = cheats(in_the_middle(on_table=True))
ADVERSARIES: tuple[Adversary, ...] = (
    cheat("one arm alone brings the cups together and pours", 1, pour_alone, **ONE),
    cheat(
        "one arm sets its cup down, then the other one comes and pours", 1, pour_in_turns, **TURNS
    ),
    cheat(
        "both cups are lifted once, then one arm pours into a cup that was let go",
        3,
        lift_once_then_pour_alone,
    ),
    cheat(
        "a cup is filled on the table, grasped, and lifted afterwards",
        3,
        pour_into_a_cup_on_the_table,
        deed=in_the_middle(on_table=False),
        lacks="_cup has stood on the table with something in it",
    ),
    cheat(
        "some marbles are poured in the air, and the rest by one arm",
        4,
        pour_the_rest_alone,
        deed=in_the_middle(on_table=False),
    ),
    cheat(
        "the cups are put down beside their squares and pushed onto them",
        5,
        (push_home, Pouring(place=(-0.10, 0.0))),
        deed=back_at_home,
        lacks="outside its place at ",
    ),
    cheat("half-open fingers are pressed on both cups", 0, press_half_open_fingers, deed=pressed),
)
