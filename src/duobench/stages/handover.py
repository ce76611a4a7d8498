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
"""Changes that `last_of` can follow. An episode has time for about three changes of hands."""
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
    delivered: BySide
    """That arm received it at an earlier step and was the last to carry it."""


def handover(prop: str, *supports: str, where: Predicate | None = None) -> Handover:
    """The predicates for an object.

    Args:
        prop: The object.
        supports: Where it may be put down, beside the table: on none of them it is in the air.
        where: What must hold, beside both arms holding it, when it is handed over.
    """
    carried = {side: held(side, prop, *supports) & ~touches(side.other, prop) for side in SIDES}
    shared = all_of(*(pinched(side, prop) for side in SIDES), clear(prop, *supports))
    given = shared if where is None else shared & where
    last_carried = dict(zip(SIDES, last_of(*(carried[side] for side in SIDES)), strict=True))
    grounded = ~clear(prop, *supports)
    handed = {
        side: carried[side] & _in_one_go(given & last_carried[side.other], grounded)
        for side in SIDES
    }
    received = {side: handed[side] & ~ever(handed[side.other]) for side in SIDES}
    return Handover(
        carried=carried,
        shared=shared,
        last_carried=last_carried,
        received=received,
        delivered={side: ever(received[side]) & last_carried[side] for side in SIDES},
    )


def last_of(one: Predicate, other: Predicate) -> tuple[Predicate, Predicate]:
    """For each of two predicates, whether at earlier steps it held, and the other not since.

    `turns[n][k]` says that the two have held in turn, n + 1 times in all, number k at the end. The
    last one is the one whose longest such row the other has not prolonged. After `MAX_TURNS`
    changes it is neither.
    """
    options = (one, other)
    turns = [tuple(ever(option) for option in options)]
    for _ in range(MAX_TURNS):
        before = turns[-1]
        turns.append(tuple(ever(options[k] & before[1 - k]) for k in (0, 1)))
    first, second = (
        any_of(*(turns[n][k] & ~turns[n + 1][1 - k] for n in range(MAX_TURNS))) for k in (0, 1)
    )
    return first, second


def _in_one_go(given: Predicate, grounded: Predicate) -> Predicate:
    """It was given at an earlier step and has not been put down since, in any of the attempts."""
    attempts = []
    for _ in range(MAX_ATTEMPTS):
        failed = ever(grounded & ever(given))
        attempts.append(ever(given) & ~failed)
        given = given & failed
    return any_of(*attempts)
