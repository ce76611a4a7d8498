"""Pouring into a vessel in the air: conditions for pouring, and for keeping the contents."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import methodcaller

from duobench.core.errors import TaskError
from duobench.tasks.stages.logic import (
    Predicate,
    StateView,
    all_of,
    any_of,
    leaf,
    since,
)
from duobench.tasks.stages.predicates import (
    CylinderRegion,
    inside,
    touching,
    upright,
)
from duobench.world.scene.naming import TABLE

LYING_SPEED = 0.25
"""Speed in m/s, relative to the vessel, below which a thing lies in it. What falls is as fast after
3 mm, and comes over the rim; what lies in a vessel that is carried or tilted is slower."""
TILT_TO_POUR_DEGREES = 45.0
"""Tilt from which a vessel is poured from: what is in it then does not lie in it."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Pouring:
    """Predicates about things that are poured into a vessel; made by `pouring`."""

    some: Predicate
    """At least one thing lies in the vessel, which has not stood on the table since the first."""
    all: Predicate
    kept: Predicate
    """Every thing lies in the vessel, and none has left it since `all` held."""


def pouring(
    things: Sequence[str],
    vessel: str,
    room: tuple[float, float, float],
    *,
    held: Predicate,
) -> Pouring:
    """The predicates for things and a vessel.

    Things lie in a vessel if they are in its lower half, no faster than it, and it is upright
    enough: not in the air above it or between its walls, nor in one on its side.

    Args:
        things: What is poured.
        vessel: What it is poured into; its z axis points up through its mouth.
        room: Radius, floor and rim of the vessel's hollow in its own frame, in metres.
        held: How the vessel must be held when things are poured.

    Raises:
        TaskError: There is nothing to pour.
    """
    things = tuple(things)
    if not things:
        raise TaskError(f"Nothing is poured into {vessel!r}: name one thing at least.")
    radius, floor, rim = room
    hollow = CylinderRegion(
        body=vessel,
        radius=radius,
        low=floor,
        high=rim,
    )
    reach = math.hypot(radius, (floor + rim) / 2)
    lower = replace(hollow, high=(floor + rim) / 2)
    within = [inside(thing, hollow) for thing in things]
    slow = [_slow(thing, vessel) for thing in things]
    low = [inside(thing, lower) for thing in things]
    lying = [part & other for part, other in zip(low, slow, strict=True)]

    look = methodcaller(
        "heights_inside",
        things,
        vessel,
        radius=radius,
        low=floor,
        high=rim,
    )

    def any_within(state: StateView) -> bool:
        return within[0].test(state) or len(state.once(look, look)) > 0

    def each_within(state: StateView) -> bool:
        return len(state.once(look, look)) == len(things)

    def any_lies(state: StateView) -> bool:
        heights: dict[int, float] = state.once(look, look)
        if len(heights) == len(things) and each_lies(state):
            return True
        return any(
            up <= lower.high and slow[number].test(state)
            for number, up in heights.items()
        )

    def each_lies(state: StateView) -> bool:
        heights = state.once(look, look)
        if len(heights) < len(things) or max(heights.values()) > lower.high:
            return False
        clearly = state.simulation.are_slower(things, vessel, LYING_SPEED, within=reach)
        return clearly or all(part.test(state) for part in slow)

    def count(state: StateView) -> str:
        return (
            f"{sum(part.ask(state) for part in lying)} of {len(things)} lie in {vessel}"
        )

    some = _at_once(any_of(*within), any_within)
    all_within = _at_once(all_of(*within), each_within)
    some_lie = _at_once(any_of(*lying), any_lies)
    all_lie = _at_once(all_of(*lying), each_lies)
    all_within = all_within.called(f"all are in {vessel}", count)
    some_lie = some_lie.called(f"something lies in {vessel}", count)
    all_lie = all_lie.called(f"all lie in {vessel}", count)
    # What was in it on the table does not count, until it is empty again.
    stood = since(touching(vessel, TABLE) & some, reset=~some).called(
        f"{vessel} has stood on the table with something in it"
    )
    pours = all_of(held, ~stood, upright(vessel, math.radians(TILT_TO_POUR_DEGREES)))
    all_poured = (pours & all_lie).called(f"all is poured into {vessel} in the air")
    return Pouring(
        some=pours & some_lie,
        all=all_poured,
        kept=since(all_poured, reset=~all_within) & all_lie,
    )


def _at_once(whole: Predicate, test: Callable[[StateView], bool]) -> Predicate:
    """The same, where `test` answers it for one simulation without asking all of its parts."""
    return replace(whole, test=test, looks=True)


def _slow(thing: str, vessel: str) -> Predicate:
    return leaf(
        f"{thing} is slow in {vessel}",
        lambda state: state.simulation.relative_speed(thing, vessel) < LYING_SPEED,
        otherwise=lambda _state: f"{thing} still moves in {vessel}",
    )
