"""One arm holds a lid or a door open while the other one brings something: asymmetric support.

Lids and doors here shut by themselves. So a lid that stays open longer than one that was thrown
open, with nothing of the bringing arm against it, is held open by the other arm. That is asked for
at a moment at which the bringing arm holds the object, and it stays true until the object is where
it belongs. What happens to the lid after that is free.

To hold is to support: a contact that pushes towards open, or a grasp. A touch does not. A finger
that rests behind a door without load, while the other arm pushes, cannot be told from one that
bears it. An arm that turns the lid further shut than it held it, while the other one keeps it open,
holds nothing.

A hand that goes in may brush the lid, push it further open, or bear it for a while, as long as the
other hand stays where it held the lid, which would turn onto it: who holds it shows when the first
hand is gone. If the lid has not shut in between and still does not shut, the other arm held it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from duobench.core.types import SIDES, Side
from duobench.tasks.stages.logic import (
    Kept,
    Predicate,
    Since,
    StateView,
    all_of,
    any_of,
    held_for,
    kept,
    since,
)
from duobench.tasks.stages.placing import put
from duobench.tasks.stages.predicates import (
    FLICKER_SECONDS,
    arm_touches,
    backs,
    grasped,
    grasped_by_any,
    hinge_open,
    lifted,
    shuts,
    supports,
    touching,
)

UNSUPPORTED_SECONDS = 0.6
"""Seconds that an open lid or door needs support: thrown open by any speed,
none of them stays open so long by itself (at most 0.5 s). The supporting arm may lose it for as
long, as fingers do that slip along it."""
RELIEVED_SECONDS = 1.0
"""Seconds in all that the other arm may bear the lid in the supporting one's stead,
since the latter was last seen to hold it alone: with that one away from where it held the lid."""
NEAR = 0.015
"""How far in metres the supporting hand may be from where it held the lid for as long as it likes,
while the lid lies on the bringing arm or is pushed further open by it."""
SHUT_SECONDS = 0.5
"""Seconds in all that the supporting arm may turn the lid shut while the bringing one keeps it
open, since it was last seen to hold it alone [task definitions]."""
ANGLE_UNIT = 0.025
"""Resolution in radians of the angle at which an arm held the lid."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Support:
    """Predicates about an object and a lid; made by `support`."""

    supported: Predicate
    """One arm lifts the object while the other one supports the open lid: neither the first arm nor
    the object has touched it for `UNSUPPORTED_SECONDS`."""
    upheld: Predicate
    """Condition of `supported` that stays: the lid is open, and the object is in that arm's hand or
    put, or it is delivered."""
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
    again: Predicate,
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
        again: It is lifted off the floor again.
        backing: How far in metres the supporting hand may be from a lid that lies on the bringing
            arm, where it would fall onto the supporting hand.
    """
    is_open = hinge_open(lid, angle)
    grazed = {
        side: (arm_touches(side, lid) | touching(prop, lid)).called(
            f"{side} arm or {prop} touches {lid}"
        )
        for side in SIDES
    }

    def held_open(side: Side) -> Predicate:
        """It is open, and neither that arm nor the object holds it."""
        apart = (is_open & ~grazed[side]).called(
            f"{lid} is open, {side} arm and {prop} away"
        )
        return held_for(apart, UNSUPPORTED_SECONDS)

    bears = {side: supports(side.other, lid) for side in SIDES}
    supported: Mapping[Side, Predicate] = {
        side: all_of(
            lifted(side, prop, fixture, lid), bears[side], held_open(side)
        ).called(f"{side} lifts {prop} while {side.other} holds {lid} open")
        for side in SIDES
    }
    void = {
        side: ~is_open | held_for(arm_touches(side.other, prop), FLICKER_SECONDS)
        for side in SIDES
    }
    # Not an arm that has been away from where it held the lid, or that has pulled it from there,
    # which is measured only once it matters.
    robbed: dict[Side, Since] = {}
    gone: dict[Side, Predicate] = {}
    for side in SIDES:
        begun, holder = since(supported[side]), side.other
        held_at = kept(
            f"the angle at which {holder} held {lid}",
            lambda state: state.simulation.angle(lid),
            when=supported[side],
            unit=ANGLE_UNIT,
            most=math.pi,
        )
        pulled = all_of(begun, grazed[side], shuts(holder, lid))
        shut = held_for(pulled, SHUT_SECONDS, reset=supported[side])
        robbed[side] = since(
            all_of(shut, pulled, _shut_from(held_at, lid)),
            reset=supported[side] & ~there,
        ).called(f"{holder} has turned {lid} shut")
        idle = begun & ~bears[side]
        beyond = (idle & ~backs(holder, lid, backing)) if backing else idle
        away = (idle & ~_near(holder, lid, held_at, backing)) if backing else idle
        gone[side] = any_of(
            held_for(
                beyond.called(f"{holder} is away from {lid}"), UNSUPPORTED_SECONDS
            ),
            held_for(
                away.called(f"{holder} is not where it held {lid}"),
                RELIEVED_SECONDS,
                reset=supported[side],
            ),
        )
    lost = {
        side: any_of(
            void[side],
            held_for(grazed[side], FLICKER_SECONDS),
            held_for(~bears[side], UNSUPPORTED_SECONDS),
        )
        for side in SIDES
    }
    # With the object at its goal, the lid shows who holds it.
    shown = {
        side: all_of(
            bears[side],
            held_open(side),
            since(supported[side], reset=void[side] | gone[side]),
        ).called(f"{side.other} shows that it holds {lid} open")
        for side in SIDES
    }
    delivered_by = (
        all_of(
            put(
                prop,
                there,
                side,
                again=again,
            ),
            ~robbed[side],
            since(supported[side], reset=lost[side]).called(
                f"{side.other} has held {lid} open all the way"
            )
            | shown[side],
        ).called(f"{side} has brought {prop} in while {side.other} held {lid} open")
        for side in SIDES
    )
    delivered = any_of(*delivered_by).called(
        f"one arm brought {prop} in while the other held {lid} open"
    )
    # What was led in, raised again and dropped is told of by its drop.
    delivered = since(delivered, reset=~goal).told_of(
        f"when {prop} was let go", grasped_by_any(prop)
    )
    upheld = (
        all_of(
            grasped(side, prop)
            | put(
                prop,
                there,
                side,
                again=again,
            ),
            ~robbed[side],
            supported[side] | since(supported[side], reset=void[side]),
        )
        for side in SIDES
    )
    return Support(
        supported=any_of(*supported.values()),
        upheld=any_of(*upheld, delivered),
        delivered=delivered,
    )


def _near(
    holder: Side,
    lid: str,
    held_at: Kept,
    backing: float,
) -> Predicate:
    """The hand is nearly where it held the lid, which may have been pushed further open."""

    def test(state: StateView) -> bool:
        sim = state.simulation
        turned = max(0.0, sim.angle(lid) - held_at.value(state))
        gaps = sim.contacts.behind(holder, lid, sim.hinge_axis(lid), backing)
        return any(gap <= NEAR + turned * radius for gap, radius in gaps)

    return Predicate(f"{holder} is where it held {lid}", test, held_at.bits)


def _shut_from(held_at: Kept, lid: str) -> Predicate:
    """The lid is further shut than it was held."""
    return Predicate(
        f"{lid} is further shut than it was held",
        lambda state: state.simulation.angle(lid) < held_at.value(state),
        held_at.bits,
    )
