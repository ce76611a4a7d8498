"""Sincere ways to put a cube into a chest whose lid another arm holds open."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from duobench.experts.handling import LET_GO
from duobench.experts.motion import Arms, Script, follow, move, release, together
from duobench.experts.scripts.hinge_chest import Insertion, fetch, lower, open_lid, under_lid
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.chest import CAVITY, RIM_HEIGHT, WALL
from duobench.sim.simulation import Simulation
from duobench.types import Side
from tests.sincere.sincere import Way, ways_to
from tests.steps import Act, by, do, pause

OPEN = 0.8
"""Angle in radians from which on the lid counts as open [task definitions]."""
PLAY = 0.002
"""How far from the chest's floor a cube that lies on it may seem to be, in metres."""
SLOW = 0.02
"""Speed in m/s below which a cube lies still."""
HIGHEST = 0.077
"""How high above the rim a hand lets go that the lid keeps from coming lower, in metres."""
UPRIGHT, ROOM = 1.42, 0.1
"""Tilt of a hand and angle of the lid together in radians from which on the hand fits under the
lid, and how much further in it may go for each radian more, in metres."""
OUTWARD, SLOWLY, TREMBLING = 0.15, 0.15, 0.25
"""Shares of the ways taken at random with a hand turned outwards, at half the speed, trembling."""
KINDS = (0.5, 0.1, 0.2, 0.2)
"""Shares of those in which both arms work at once, one after the other, in which the lid sinks onto
the hand, and in which the hand leans on it."""


def done_by(bringer: Side) -> Callable[[Simulation], bool]:
    """The cube lies in the chest, no hand is at it, and the lid is still open.

    The lid shuts by itself, and these scripts never lift it again: what is open for a second with
    nothing of the arm that brought the cube at it is held by the other one, and was all the time.
    """

    def done(sim: Simulation) -> bool:
        x, y, z = sim.relative_position("cube", "chest")
        lies = sim.contacts.between("cube", "chest") and abs(z - WALL - CUBE_EDGE / 2) < PLAY
        hands = any(sim.contacts.arm(side, "cube") for side in Side)
        alone = not sim.contacts.arm(bringer, "chest/lid")
        return (
            lies
            and abs(x) < CAVITY[0] / 2
            and abs(y) < CAVITY[1] / 2
            and sim.speed("cube")[0] < SLOW
            and not hands
            and alone
            and sim.angle("chest/lid") >= OPEN
        )

    return done


def let_go(arms: Arms, way: Insertion) -> Script:
    """Let the cube go, unless the hand did not get it low enough, and leave the chest."""
    if arms.sim.min_height("cube") < RIM_HEIGHT + HIGHEST:
        yield from release(arms, way.side, opening=LET_GO)
    yield from retreat(arms, way)


def retreat(arms: Arms, way: Insertion) -> Script:
    """The inserting arm goes up and away."""
    here = arms.targets[way.side]
    yield from move(arms, {way.side: here.moved(z=0.13)}, speed=0.3)
    yield from move(arms, {way.side: here.moved(y=way.side.sign * 0.2, z=0.16)}, arrive=False)


def both(arms: Arms, way: Insertion) -> Script:
    """One arm opens the lid while the other one fetches the cube."""
    yield from together(open_lid(arms, way), fetch(arms, way))


def put_in(way: Insertion) -> Act:
    """The expert's way with other numbers, and the hand leaves the chest."""
    return do((both, way), (lower, way), (let_go, way))


def one_after_the_other(way: Insertion) -> Act:
    """The cube is in hand before the other arm begins to open the lid."""
    return do((fetch, way), (open_lid, way), (lower, way), (let_go, way))


def sink(arms: Arms, way: Insertion, start: float, end: float) -> Script:
    """The holder leads the lid from one angle to another."""
    chest, holder = arms.sim.pose("chest"), way.side.other
    yield from follow(
        arms, lambda f: {holder: under_lid(chest, holder, start + f * (end - start))}, 0.4
    )


def slipped(way: Insertion, sunk: float, steps: int) -> Act:
    """The lid sinks by so many radians onto the inserting hand for some control steps, and the
    holder takes it again.
    """
    high, low = way.open_angle, way.open_angle - sunk
    down, up = (sink, way, high, low), (sink, way, low, high)
    return do((both, way), (pause, 10), (lower, way), down, (pause, steps), up, (let_go, way))


def along_the_lid(way: Insertion, lean: float) -> Act:
    """The hand that has come down is led so many metres towards the open lid, leans on it for half
    a second, and lets go there.
    """
    on_it = (by, way.side, {"x": lean, "speed": 0.1})
    return do((both, way), (pause, 10), (lower, way), on_it, (pause, 15), (let_go, way))


def _way(name: str, insertion: Insertion, **fields: Any) -> Way:
    way = ways_to(lambda arms, how: put_in(how)(arms), done_by(insertion.side), Insertion())
    return way(name, insertion, **fields)


PLAIN = Insertion()
STEEP = Insertion(tilt=0.0, place=(-0.045, 0.045))


def _over_rim(height: float, grasp_height: float = PLAIN.grasp_height) -> float:
    """Height of the tool with the cube's lowest point at a height above the rim, in metres."""
    return RIM_HEIGHT + height + grasp_height


STOPPED = Insertion(tilt=0.0, place=(-0.025, 0.045), open_angle=1.25)
FRONT = (-0.045, 0.045)
"""Far in front of the open lid, in the chest's frame."""
ASIDE = Insertion(tilt=0.0, yaw=math.pi / 2, place=FRONT)
BRUSH = replace(STEEP, tilt=0.2)

WAYS: tuple[Way, ...] = (
    _way("as the expert, and the hand leaves", PLAIN),
    _way("a hand that comes straight down", STEEP),
    _way(
        "a hand straight down, its camera aside, the lid at 1.1 rad", replace(ASIDE, open_angle=1.1)
    ),
    _way(
        "a hand straight down, its camera aside, the lid at 1.0 rad", replace(ASIDE, open_angle=1.0)
    ),
    _way("a hand straight down, the lid at its stop", replace(STEEP, open_angle=1.39)),
    _way("a hand that leans by half a radian", Insertion(tilt=0.5)),
    _way("a lid opened to 1.1 rad", Insertion(open_angle=1.1, tilt=0.5, place=FRONT)),
    _way("a lid opened to 1.2 rad", Insertion(open_angle=1.2, place=(-0.035, 0.045))),
    _way("far in front of the lid", Insertion(place=FRONT)),
    _way("near the hinge", Insertion(place=(-0.005, 0.045), tilt=0.45)),
    _way("at the left wall", Insertion(place=(-0.03, 0.085))),
    _way("at the right of the middle", Insertion(place=(-0.03, -0.02))),
    _way("let go at the rim", Insertion(drop_height=0.085)),
    *(
        _way(f"let go {1000 * high:.0f} mm above the rim", Insertion(drop_height=_over_rim(high)))
        for high in (0.020, 0.040, 0.070)
    ),
    _way("the lid stops a hand that comes straight down", STOPPED),
    _way(
        "the lid stops a hand that comes straight down far in front",
        replace(STOPPED, place=(-0.045, 0.02)),
    ),
    _way("grasped at the tips of the fingers", Insertion(grasp_height=0.045)),
    _way("grasped deep in the fingers", Insertion(grasp_height=0.026)),
    _way("at half the speed", PLAIN, slowness=2),
    _way("trembling", PLAIN, tremble=0.01),
    _way("trembling, straight down", STEEP, tremble=0.01),
    _way("one arm after the other", PLAIN, script=one_after_the_other(PLAIN)),
    _way("a hand that leans on the lid", PLAIN, script=along_the_lid(PLAIN, 0.03)),
    _way("a hand that leans hard on the lid", BRUSH, script=along_the_lid(BRUSH, 0.04)),
    _way("the lid sinks onto the hand for a moment", PLAIN, script=slipped(PLAIN, 0.3, 10)),
    _way("the lid lies on the hand for a second", PLAIN, script=slipped(PLAIN, 0.4, 30)),
)


def sample(rng: np.random.Generator) -> Way:
    """A way taken at random over how the lid is held and the cube goes in."""
    open_angle = rng.uniform(1.0, 1.39)
    # A hand leans as the lid does, or goes in further in front of it.
    tilt = rng.uniform(max(0.0, UPRIGHT - open_angle), 0.5)
    room = ROOM * (tilt + open_angle - UPRIGHT)
    insertion = Insertion(
        open_angle=open_angle,
        place=(rng.uniform(-0.05, min(-0.05 + room, 0.0)), rng.uniform(-0.03, 0.08)),
        tilt=tilt,
        yaw=math.pi / 2 if rng.random() < OUTWARD else 0.0,
        grasp_height=(grasp := rng.uniform(0.026, 0.042)),
        drop_height=rng.uniform(0.042, _over_rim(0.05, grasp)),
    )
    slowness = 2 if rng.random() < SLOWLY else 1
    tremble = 0.01 if rng.random() < TREMBLING else 0.0
    kinds = {
        "together": put_in(insertion),
        "in turn": one_after_the_other(insertion),
        "sinks": slipped(insertion, rng.uniform(0.05, 0.3), int(rng.integers(3, 30))),
        "leans": along_the_lid(insertion, rng.uniform(0.0, 0.04)),
    }
    kind = str(rng.choice(list(kinds), p=KINDS))
    return _way("", insertion, script=kinds[kind], slowness=slowness, tremble=tremble)
