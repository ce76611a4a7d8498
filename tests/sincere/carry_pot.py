"""Sincere ways to carry a pot to the stove with both arms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from duobench.experts.handling import carry
from duobench.experts.motion import Arms, Script, wait
from duobench.experts.scripts.carry_pot import HandleGrasp, carry_over, grasp, let_go
from duobench.objects.pot import PLATE
from duobench.sim.simulation import Simulation
from duobench.types import SIDES, Side
from tests.sincere.sincere import Way, ways_to

LEFT, RIGHT = SIDES
NEAR_X, NEAR_Y = 0.10, 0.08
"""How far from the plate's centre the pot's may be, in metres [task definitions]."""
TILT = math.radians(10.0)
"""Largest tilt of a pot that stands upright [task definitions]."""
SLOW = 0.02
"""Speed in m/s below which a pot stands still."""

LAG = 0.015
"""How much lower than told a pot that is lifted may be, in metres: the servos lag."""
NEARLY, SETTLING = 0.015, 10
"""Height in metres above the plate at which the pot stops on its way down, and for how many control
steps: what is led from there to a height is let go at it."""
SLOWLY = 0.15
"""Share of the ways taken at random that go at half the speed."""
TREMBLES = (0.0, 0.0, 0.01, 0.02)
"""Trembling of ways taken at random, in radians."""


def done(sim: Simulation) -> bool:
    """The pot stands upright and still near the middle of the plate, and no arm is at it."""
    x, y, _ = sim.relative_position("pot", "stove")
    parts = ("pot", "pot/left_handle", "pot/right_handle")
    hands = any(sim.contacts.arm(side, part) for side in SIDES for part in parts)
    return (
        not hands
        and sim.contacts.partners("pot") == {"stove"}
        and abs(x) <= NEAR_X
        and abs(y) <= NEAR_Y
        and sim.rotation("pot")[2, 2] >= math.cos(TILT)
        and sim.speed("pot")[0] < SLOW
    )


def lifted(sim: Simulation, height: float) -> bool:
    """Both hands are at the pot, and it is in the air and level: nobody goes on without that."""
    hands = all(sim.contacts.gripper(side, f"pot/{side}_handle") for side in SIDES)
    return hands and sim.min_height("pot") > height and sim.rotation("pot")[2, 2] > math.cos(TILT)


@dataclass(frozen=True, kw_only=True, slots=True)
class Carrying:
    """How the pot is carried; the defaults are the expert's way."""

    hold: Mapping[Side, HandleGrasp] = field(default_factory=dict)
    """How each arm takes its handle."""
    lift: float = 0.06
    """How far the pot is lifted, in metres."""
    clearance: float = 0.04
    """Height above the plate at which it is carried, in metres."""
    place: tuple[float, float] = (0.0, 0.0)
    """Where it is put down, from the plate's centre, in the table frame and metres."""
    release: float = 0.0
    """Height above the plate to which it is led before it is let go; it is pressed down below 0."""
    speed: float = 0.06
    """How fast it is lowered, in m/s."""
    pause: int = 8
    """Control steps before it is let go."""
    order: tuple[tuple[Side, ...], ...] = (SIDES,)
    """The arms that let go together, one group after the other."""


def lower_to(arms: Arms, height: float, speed: float) -> Script:
    """Lower the pot from where it really is to a height above the plate in metres."""
    yield from wait(SETTLING)
    here = arms.sim.min_height("pot") - PLATE[2]
    yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=height - here), speed=speed)


def put(arms: Arms, way: Carrying) -> Script:
    """Both arms take the pot, carry it and put it down."""
    yield from grasp(arms, hold=way.hold)
    yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=way.lift), speed=0.15)
    yield from wait(6)
    if not lifted(arms.sim, way.lift - LAG):
        return
    x, y, _ = arms.sim.position("stove")
    x, y = x + way.place[0], y + way.place[1]
    yield from carry_over(arms, x, y, height=way.clearance)
    yield from lower_to(arms, NEARLY, way.speed)
    yield from lower_to(arms, way.release, way.speed)
    yield from wait(way.pause)
    for sides in way.order:
        yield from let_go(arms, *sides)


way = ways_to(put, done, Carrying())


def _both(**changes: float) -> dict[Side, HandleGrasp]:
    return dict.fromkeys(SIDES, HandleGrasp(**changes))


WAYS: tuple[Way, ...] = (
    *(
        way(f"let go {height} mm above the plate", Carrying(release=height / 1000))
        for height in (0, 1, 3, 5, 8)
    ),
    *(
        way(f"pressed {-height} mm into the plate", Carrying(release=height / 1000))
        for height in (-1, -3, -5)
    ),
    way("handles at the fingertips", Carrying(hold=_both(height=0.012))),
    way("handles deep in the fingers", Carrying(hold=_both(height=-0.008))),
    way(
        "handles taken near their ends, at opposite corners",
        Carrying(hold={LEFT: HandleGrasp(along=0.02), RIGHT: HandleGrasp(along=-0.02)}),
    ),
    way("hands turned by 0.3 rad", Carrying(hold=_both(yaw=0.3))),
    way("hands turned about", Carrying(hold=_both(yaw=math.pi))),
    way("hands that lean", Carrying(hold=_both(tilt=0.3))),
    way("at the edge of the place", Carrying(place=(-0.06, 0.08))),
    way("carried high", Carrying(lift=0.12, clearance=0.12)),
    way("lowered fast", Carrying(speed=0.2, release=-0.002)),
    way("the left arm lets go first", Carrying(order=((LEFT,), (RIGHT,)))),
    way(
        "the right arm lets go first, pressed in",
        Carrying(order=((RIGHT,), (LEFT,)), release=-0.004),
    ),
    way("at half the speed", slowness=2),
    way("trembling by 10 mrad", tremble=0.01),
    way("trembling by 20 mrad", tremble=0.02),
    way("trembling, let go 5 mm above the plate", Carrying(release=0.005), tremble=0.01),
)


def sample(rng: np.random.Generator) -> Way:
    """A way taken at random over how the handles are taken and the pot is put down."""
    hold = {
        side: HandleGrasp(
            height=rng.uniform(-0.008, 0.014),
            along=rng.uniform(-0.02, 0.02),
            yaw=rng.uniform(-0.3, 0.3),
            tilt=rng.uniform(-0.2, 0.3),
        )
        for side in SIDES
    }
    # Who lets go one hand after the other puts the pot down first.
    orders = ((SIDES,), ((LEFT,), (RIGHT,)), ((RIGHT,), (LEFT,)))
    order = orders[rng.choice(len(orders), p=(0.7, 0.15, 0.15))]
    tremble = float(rng.choice(TREMBLES))
    highest = (0.008 if tremble == 0.0 else 0.004) if len(order) == 1 else 0.0
    carrying = Carrying(
        hold=hold,
        lift=rng.uniform(0.045, 0.12),
        clearance=rng.uniform(0.02, 0.10),
        place=(rng.uniform(-0.06, 0.06), rng.uniform(-0.08, 0.08)),
        release=rng.uniform(-0.005, highest),
        speed=rng.uniform(0.05, 0.15),
        pause=int(rng.integers(6, 15)),
        order=order,
    )
    slowness = 2 if rng.random() < SLOWLY else 1
    return way(how=carrying, slowness=slowness, tremble=tremble)
