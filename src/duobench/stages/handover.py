"""From hand to hand: what counts as handing an object over, for the tasks of sequential handoff.

A handover is three moments in order: one gripper has the object alone, both have it in the air, the
other one has it alone. The object has not stood anywhere between the last two, so that putting it
down and picking it up with the other arm is none. Everything is written with `ever`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from duobench.stages.predicates import (
    Predicate,
    all_of,
    any_of,
    clear,
    ever,
    held,
    pinched,
    touches,
)
from duobench.types import SIDES, Side

MAX_TURNS = 4
"""How often the object may change hands before nobody is taken to be its last carrier. An episode
has time for about three changes."""
MAX_ATTEMPTS = 3
"""Handovers that may end on the table before no further one counts; each costs about a quarter of
an episode."""

BySide = Mapping[Side, Predicate]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Handover:
    """Predicates about one object on its way from hand to hand; made by `handover`."""

    carried: BySide
    """Held by that arm, and the other gripper is not in contact with it."""
    shared: Predicate
    """Both grippers pinch it, clear of table and supports."""
    last_carried: BySide
    """That arm was the last to carry it alone, at an earlier step."""
    received: BySide
    """That arm carries it, handed over by the other one. The first handover of an episode decides
    which arm gives and which one receives: what is handed back is not received."""
    delivered: Predicate
    """It was received at an earlier step, and the arm that received it was the last to carry it."""


def handover(prop: str, *supports: str) -> Handover:
    """The predicates for an object.

    Args:
        prop: The object.
        supports: Where it may be put down, beside the table: on none of them it is in the air.
    """
    carried = {side: held(side, prop, *supports) & ~touches(side.other, prop) for side in SIDES}
    shared = all_of(*(pinched(side, prop) for side in SIDES), clear(prop, *supports))
    last_carried = _last(carried)
    grounded = ~clear(prop, *supports)
    handed = {
        side: carried[side] & _in_one_go(shared & last_carried[side.other], grounded)
        for side in SIDES
    }
    received = {side: handed[side] & ~ever(handed[side.other]) for side in SIDES}
    delivered = any_of(*(ever(received[side]) & last_carried[side] for side in SIDES))
    return Handover(
        carried=carried,
        shared=shared,
        last_carried=last_carried,
        received=received,
        delivered=Predicate(f"{prop} was handed over", delivered.test, delivered.parts),
    )


def _last(carried: BySide) -> BySide:
    """For each arm, whether it was the last to carry the object.

    `turns[n][side]` says that alternating arms have carried it n + 1 times, that side at the end.
    The last carrier is the one whose longest row the other arm has not prolonged.
    """
    turns = [{side: ever(carried[side]) for side in SIDES}]
    for _ in range(MAX_TURNS):
        before = turns[-1]
        turns.append({side: ever(carried[side] & before[side.other]) for side in SIDES})
    return {
        side: any_of(*(turns[n][side] & ~turns[n + 1][side.other] for n in range(MAX_TURNS)))
        for side in SIDES
    }


def _in_one_go(given: Predicate, grounded: Predicate) -> Predicate:
    """It was given at an earlier step and has not been put down since, in any of the attempts."""
    attempts = []
    for _ in range(MAX_ATTEMPTS):
        failed = ever(grounded & ever(given))
        attempts.append(ever(given) & ~failed)
        given = given & failed
    return any_of(*attempts)
