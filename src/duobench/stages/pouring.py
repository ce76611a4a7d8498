"""Pouring into a vessel in the air: what counts as poured, and as kept until it is put down.

Many small things are asked about at once, in one predicate that stops at the first that decides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from duobench.scene.naming import TABLE
from duobench.sim.simulation import Simulation
from duobench.stages.predicates import (
    CylinderRegion,
    Predicate,
    all_of,
    since,
    touching,
    upright,
)

LYING_SPEED = 0.25
"""Speed in m/s, relative to the vessel, below which a thing lies in it. What falls is as fast after
3 mm, and comes over the rim; what lies in a vessel that is carried or tilted is slower."""

MAX_TILT = math.radians(45.0)
"""How far a vessel is tilted at most, in radians, while things lie in it."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Pouring:
    """Predicates about things that are poured into a vessel; made by `pouring`."""

    some: Predicate
    """At least one thing lies in the vessel, which has not stood on the table since the first."""
    all: Predicate
    """The same of every thing."""
    kept: Predicate
    """Every thing lies in the vessel, and none has left it since `all` held."""


def pouring(
    things: Sequence[str], vessel: str, room: tuple[float, float, float], *, held: Predicate
) -> Pouring:
    """The predicates for things and a vessel.

    Things lie in a vessel if they are in its lower half, no faster than it, and it is upright
    enough: not in the air above it or between its walls, nor in one on its side.

    Args:
        things: What is poured.
        vessel: What it is poured into; its z axis points up through its mouth.
        room: Radius, floor and rim of the vessel's hollow in its own frame, in metres.
        held: How the vessel must be held when things are poured.
    """
    radius, floor, rim = room
    hollow = CylinderRegion(body=vessel, radius=radius, low=floor, high=rim)
    lower = replace(hollow, high=(floor + rim) / 2)
    some, every = (_number(number, things, hollow, _is_in) for number in (any, all))
    some_lie, all_lie = (_number(number, things, lower, _lies_in) for number in (any, all))
    # What was in it on the table does not count, until it is empty again.
    stood = since(touching(vessel, TABLE) & some, reset=~some)
    pours = all_of(held, ~stood, upright(vessel, MAX_TILT))
    return Pouring(
        some=pours & some_lie,
        all=pours & all_lie,
        kept=since(pours & all_lie, reset=~every) & all_lie,
    )


def _is_in(simulation: Simulation, thing: str, region: CylinderRegion) -> bool:
    return region.contains(simulation.relative_position(thing, region.body))


def _lies_in(simulation: Simulation, thing: str, region: CylinderRegion) -> bool:
    inside = _is_in(simulation, thing, region)
    return inside and simulation.relative_speed(thing, region.body) < LYING_SPEED


def _number(
    number: Callable[[Iterable[bool]], bool],
    things: Sequence[str],
    region: CylinderRegion,
    holds: Callable[[Simulation, str, CylinderRegion], bool],
) -> Predicate:
    """A question holds of any or of all things."""
    which = f"{number.__name__} of {things[0]} to {things[-1]}"
    return Predicate(
        f"{which}: {holds.__name__.strip('_')} {region.body}",
        lambda m: number(holds(m.simulation, thing, region) for thing in things),
    )
