"""From hand to hand: what counts as handing an object over, for the tasks of sequential handoff.

A handover is three moments in order: one gripper has the object alone, both have it in the air, the
other one has it alone. The object has not stood anywhere between the last two, so that putting it
down and picking it up with the other arm is none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from duobench.scene.naming import TABLE
from duobench.stages.predicates import (
    Predicate,
    all_of,
    grasped,
    lifted,
    off_table,
    since,
    touches,
    touching,
)
from duobench.types import SIDES, Side

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
    """That arm carries it, handed over by the other one. The first handover decides which arm gives
    and which one receives, until it is put down: what is handed back is not received."""
    delivered: BySide
    """That arm received it at an earlier step, and since that arm last carried it neither the other
    gripper nor the table has touched it."""


def handover(prop: str, *supports: str, where: Predicate | None = None) -> Handover:
    """The predicates for an object.

    Args:
        prop: The object.
        supports: Where it may be put down, beside the table: on none of them it is in the air.
        where: What must hold, beside both arms holding it, when it is handed over.
    """
    carried = {side: lifted(side, prop, *supports) & ~touches(side.other, prop) for side in SIDES}
    shared = all_of(*(grasped(side, prop) for side in SIDES), off_table(prop, *supports))
    given = shared if where is None else shared & where
    last_carried = {side: since(carried[side], reset=carried[side.other]) for side in SIDES}
    grounded = ~off_table(prop, *supports)
    handed = {
        side: carried[side] & since(given & last_carried[side.other], reset=grounded)
        for side in SIDES
    }
    received = {side: handed[side] & ~since(handed[side.other], reset=grounded) for side in SIDES}
    brought = {
        side: since(carried[side], reset=touches(side.other, prop) | touching(prop, TABLE))
        for side in SIDES
    }
    return Handover(
        carried=carried,
        shared=shared,
        last_carried=last_carried,
        received=received,
        delivered={side: since(received[side]) & brought[side] for side in SIDES},
    )
