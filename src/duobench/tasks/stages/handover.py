"""Handover: conditions for handing an object from arm to arm, in tasks of sequential handoff.

A handover is three moments in order: one arm holds the object alone, both hold it, the other one
holds it alone. Between the last two it is neither put down nor let go, so that laying it down for
the other arm is no handover. A handover is forgotten once the giver carries the object again.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from duobench.core.types import SIDES, Side
from duobench.tasks.stages.logic import (
    Predicate,
    StateView,
    all_of,
    any_of,
    held_for,
    since,
)
from duobench.tasks.stages.passage import Passage
from duobench.tasks.stages.predicates import (
    FLICKER_SECONDS,
    LIFTED_HEIGHT,
    grasped,
    lifted,
    off_table,
    raised,
    released,
    touches,
    touching,
)
from duobench.world.scene.naming import TABLE

BySide = Mapping[Side, Predicate]


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Handover:
    """Predicates about one object on its way from arm to arm; made by `handover`."""

    prop: str
    shared: Predicate
    """Both arms hold it in the air, or have held it."""
    held: BySide
    """Whether each arm holds it in the air."""
    giver: BySide
    """Whether each arm has it to give: it has picked it up, or brought it through."""
    met: BySide
    """Whether each arm holds it in the air with the giver, or has since the giver was alone."""
    received: BySide
    """Whether each arm holds it alone, handed over by the giver; the giver never receives."""
    in_hand: BySide
    """Whether each arm grasps what it received, and has not let go since it last held it alone:
    in the air, or put down and still in its grasp."""
    disturbed: BySide
    """The other gripper or the table touches it."""

    def stays(self, there: Predicate) -> tuple[Predicate, Predicate, Predicate]:
        """Condition that stays of lifting it, of meeting in the air and of handing it over.

        Args:
            there: As in `put`.
        """
        beyond = any_of(*self.in_hand.values(), self.put(there))
        moments = self.held, self.met, self.received
        lifted, met, received = (
            any_of(*by_side.values(), beyond) for by_side in moments
        )
        return lifted, met, received

    @property
    def handed_over(self) -> Predicate:
        """An arm holds it alone, handed over by the other one."""
        return any_of(*self.received.values())

    def put(self, there: Predicate) -> Predicate:
        """The arm that received it has put it at its place, where it has been since.

        Args:
            there: It is at its place, or so little above that it is put down when it is let go.
        """
        return any_of(*(self._put_by(side, there) for side in SIDES))

    def _put_by(self, side: Side, there: Predicate) -> Predicate:
        event = (self.in_hand[side] & there).called(
            f"{side} has {self.prop} at its place"
        )
        put = since(event, reset=~there | self.disturbed[side])
        return put.told_of(
            f"when {side} let {self.prop} go", self.in_hand[side]
        ).called(f"{side} has received {self.prop} and put it down")


def handover(
    prop: str,
    *supports: str,
    way: Passage | None = None,
    top: float = 0.0,
) -> Handover:
    """The predicates for an object.

    Without a way, the giver is the arm that has picked the object up: the first to hold it alone
    since it was last put down or let go.

    Args:
        prop: The object.
        supports: Where it may be put down, beside the table: on none of them it is in the air.
        way: The way that the object takes. The giver is the arm that brings it through, and it is
            handed over on the far side, or while it is in the hole.
        top: Height in metres of a flat support: what lies on it is as high as what was lifted off
            the table, and fingers that close on it may part the two for a step.
    """
    held = {side: lifted(side, prop, *supports) for side in SIDES}
    alone = {
        side: (held[side] & ~touches(side.other, prop)).called(
            f"{side} alone holds {prop}"
        )
        for side in SIDES
    }
    both = all_of(*held.values()).called(f"both arms hold {prop} in the air")
    loose = held_for(released(prop), FLICKER_SECONDS).called(f"{prop} is let go")
    put_down = loose | ~off_table(prop, *supports)
    if way is None:
        giver = {
            side: since(
                (alone[side] & ~since(alone[side.other], reset=put_down)).called(
                    f"{side} picks {prop} up"
                ),
                reset=put_down,
            )
            for side in SIDES
        }
    else:
        # The last arm to hold it alone brings it through; where both hold it in the hole, the last
        # one before that.
        last = {side: since(alone[side], reset=alone[side.other]) for side in SIDES}
        meeting = {
            side: all_of(both, way.within, last[side]).called(
                f"{side} brings {prop} to the other arm in the hole"
            )
            for side in SIDES
        }
        brought_in = {
            side: since(
                meeting[side], reset=any_of(meeting[side.other], put_down, ~way.within)
            )
            for side in SIDES
        }
        brings = {
            side: brought_in[side] | (last[side] & ~brought_in[side.other])
            for side in SIDES
        }
        giver = {
            side: since(
                (way.crossing & brings[side]).called(f"{side} brings {prop} through"),
                reset=put_down | ~way.through,
            )
            for side in SIDES
        }
    met = {
        side: both | since(both, reset=alone[side.other] | put_down) & giver[side.other]
        for side in SIDES
    }
    received = {
        side: all_of(
            alone[side],
            giver[side.other],
            since(both, reset=alone[side.other] | put_down),
        ).called(f"{side} receives {prop} from {side.other}")
        for side in SIDES
    }
    disturbed = {
        side: touches(side.other, prop) | touching(prop, TABLE) for side in SIDES
    }
    high = raised(prop, top + LIFTED_HEIGHT)
    aloft = {side: alone[side] & high for side in SIDES}
    in_hand = {
        side: all_of(
            grasped(side, prop),
            aloft[side] | since(aloft[side], reset=loose | disturbed[side]),
            received[side] | since(received[side], reset=alone[side.other]),
        ).called(f"{side} grasps {prop}, which it has received")
        for side in SIDES
    }
    grasps = all_of(*(grasped(side, prop) for side in SIDES))
    once = since(both).told_of(f"when both arms last grasped {prop}", grasps)

    def apart(state: StateView) -> str:
        return ", ".join((once if once.begun(state) else both).unmet(state))

    return Handover(
        prop=prop,
        shared=(both | once).called(both.name, apart),
        held=held,
        giver=giver,
        met=met,
        received=received,
        in_hand=in_hand,
        disturbed=disturbed,
    )
