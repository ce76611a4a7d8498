"""One arm holds a lid or a door open while the other one brings something: asymmetric support.

Lids and doors here shut by themselves. So whatever stays open longer than something thrown open
does, with nothing of the bringing arm against it, is held open by the other arm. That is asked for
at a moment at which the bringing arm holds the object, and it stays true until the object is where
it belongs. What happens to the lid after that is free.

A hand that goes in may brush the lid, and a lid may lie on it for a while, as long as the other
hand stays right below: who holds it shows when the first hand is gone. If the lid has not shut in
between and still does not shut, the other arm held it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from duobench.stages.placing import put
from duobench.stages.predicates import (
    Predicate,
    all_of,
    any_of,
    arm_touches,
    held_for,
    hinge_open,
    lifted,
    near,
    since,
    touches,
    touching,
)
from duobench.types import SIDES, Side

UNSUPPORTED_TIME = 0.6
"""Time in seconds for which a lid or door that is open needs support: thrown open by any speed,
none of them stays open so long by itself (at most 0.5 s). The supporting arm may lose touch with it
for as long, as fingers do that slip along it."""
GRAZE_TIME = 0.1
"""Time in seconds from which on a touch that should not be is more than a graze: the bringing arm
or the object at the lid, the supporting arm at the object. It is too short to hold a lid up."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Support:
    """Predicates about an object and a lid; made by `support`."""

    supported: Predicate
    """One arm lifts the object while the other one keeps the lid open, and touches it with its
    gripper: neither the first arm nor the object has touched the lid for `UNSUPPORTED_TIME`."""
    delivered: Predicate
    """The arm that had the object then has put it at its goal, where it has been since, and the
    other arm kept the lid open all the way."""


def support(
    prop: str,
    fixture: str,
    lid: str,
    angle: float,
    *,
    goal: Predicate,
    there: Predicate,
    backing: float = 0.0,
) -> Support:
    """The predicates for an object that goes into something with a lid or a door.

    Args:
        prop: The object.
        fixture: What it goes into.
        lid: The lid or door, a body with a hinge of the same name, that shuts by itself.
        angle: From which angle on the lid counts as open, in radians.
        goal: The object is inside.
        there: It is where it may be let go: inside, or little above.
        backing: How far in metres the supporting hand may be from a lid that lies on the bringing
            arm, where it would fall onto the supporting hand.
    """
    is_open = hinge_open(lid, angle)
    grazed = {side: arm_touches(side, lid) | touching(prop, lid) for side in SIDES}
    supported: Mapping[Side, Predicate] = {
        side: all_of(
            lifted(side, prop, fixture, lid),
            touches(side.other, lid),
            held_for(is_open & ~grazed[side], UNSUPPORTED_TIME),
        )
        for side in SIDES
    }
    void = {side: ~is_open | held_for(arm_touches(side.other, prop), GRAZE_TIME) for side in SIDES}
    lost = {
        side: any_of(
            void[side],
            held_for(grazed[side], GRAZE_TIME),
            held_for(~arm_touches(side.other, lid), UNSUPPORTED_TIME),
        )
        for side in SIDES
    }
    # With the object at its goal, the lid shows who holds it: not an arm that has been away.
    stays = {
        side: arm_touches(side.other, lid) | near(side.other, lid, backing)
        if backing
        else arm_touches(side.other, lid)
        for side in SIDES
    }
    left = {side: held_for(~stays[side], UNSUPPORTED_TIME) for side in SIDES}
    shown = {
        side: all_of(
            touches(side.other, lid),
            held_for(is_open & ~grazed[side], UNSUPPORTED_TIME),
            since(supported[side], reset=void[side] | left[side]),
        )
        for side in SIDES
    }
    brought = {
        side: all_of(
            goal,
            put(prop, there, side),
            since(supported[side], reset=lost[side]) | shown[side],
        )
        for side in SIDES
    }
    return Support(
        supported=any_of(*supported.values()),
        delivered=since(any_of(*brought.values()), reset=~goal),
    )
