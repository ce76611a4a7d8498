"""Coordination: conditions for two arms to bring one object to its place together.

That both arms had it once is worth nothing. What they bring must be in their hands until it is at
its place; what is let go before, or carried by one arm in between, must be picked up again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from duobench.tasks.stages.logic import (
    Predicate,
    all_of,
    any_of,
    held_for,
    since,
)
from duobench.tasks.stages.placing import PUT_HEIGHT, low_over
from duobench.tasks.stages.predicates import (
    grasped_apart,
    grasped_by_any,
    interrupted,
    off_table,
    raised,
    touching,
)
from duobench.world.scene.naming import TABLE

HOP_HEIGHT = 0.003
"""How far the lowest point of an object that stands may hop, in metres, while a hand that trembles
takes it or lets it go, or sink between two control steps while fingers open."""
TIP_SECONDS = 0.2
"""How long an object that one hand has let go little above its support takes to tip onto it at
most, in seconds; what is higher than `HOP_HEIGHT` for longer hangs in the other hand."""
TOGETHER_SECONDS = 1.5
"""How far apart in time two arms may bring to a place what they bring together, in seconds: people
differ by half a second, and one after the other takes several [task definitions]."""
AWAY_SECONDS = 1.0
"""Seconds that an object has to be away from a place before it may be brought there anew: an
object that only hops has been there since it came first [task definitions]."""
LANDING_DEPTH = 0.001
"""Depth below the top of its support at which the lowest point of an object may seem to be."""


def brought_together(
    one: str,
    other: str,
    there: Mapping[str, Predicate],
) -> Predicate:
    """Each gripper has one of two objects, both brought to a place within `TOGETHER_SECONDS`.

    A gripper has grasped it since before it was there, and has not let go in between. One that was
    there longer before the other has to be brought again, after `AWAY_SECONDS` elsewhere: one that
    hops is there all the time.

    Args:
        one: An object.
        other: Another one.
        there: Each is at the place, or so little above that it could be put down there.
    """

    def brought(body: str, partner: str) -> Predicate:
        in_hand = grasped_by_any(body)
        away = held_for(~there[body], AWAY_SECONDS)
        before = (in_hand & away).called(f"a hand brings {body} from elsewhere")
        come = there[body] | since(there[body], reset=away)
        alone = (come & ~there[partner]).called(f"{body} is there before {partner}")
        waits = held_for(alone, TOGETHER_SECONDS)
        return since(before, reset=interrupted(in_hand) | waits)

    return all_of(grasped_apart(one, other), brought(one, other), brought(other, one))


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Carriage:
    """Predicates about an object that both arms carry by its handles; made by `carriage`."""

    carried: Predicate
    """Each gripper grasps one handle, and the object is raised in the air."""
    underway: Predicate
    """Both arms carry it, and have done so since they lifted it."""
    put_down: Predicate
    """It was carried to its place on its support, both handles grasped until it was put down; since
    then it has been neither on the table nor lifted again, nor in the air in one hand.

    What slipped from both hands at its place may be lifted and put down there again."""


def carriage(
    prop: str,
    handles: Sequence[str],
    support: str,
    *,
    place: Predicate,
    top: float,
    height: float,
) -> Carriage:
    """The predicates for an object with two handles.

    Args:
        prop: The object.
        handles: Its two handles.
        support: What it is put down on.
        place: It is where both arms have to bring it on the support.
        top: Height of the top of the support, which stands on the table, in metres.
        height: How far a carried object is raised, in metres.
    """
    bodies = (prop, *handles)
    in_both = grasped_apart(handles[0], handles[1])
    in_air = all_of(*(off_table(body, support) for body in bodies))
    on_table = any_of(*(touching(body, TABLE) for body in bodies)).called(
        f"{prop} is on the table"
    )
    on_support = touching(prop, support)
    carried = all_of(in_both, in_air, raised(prop, height)).called(
        f"both arms carry {prop}"
    )
    # The jolt of landing may shake pads off a handle for a moment: what counts is the one before.
    dropped = (
        on_support & ~in_both & since(in_air & ~in_both, reset=in_both | on_support)
    )
    dropped = dropped.called(f"{prop} comes down on {support} without both hands")
    # In the air by one hand, or by none: what was done so far is void until it stands where both
    # may begin anew, from where hands that tremble may lift one end of it a little earlier.
    let_go = interrupted(in_both | ~(in_air & raised(prop, HOP_HEIGHT))).called(
        f"{prop} is in the air, and not in both hands"
    )
    ended = any_of(on_table, interrupted(in_both), dropped)

    def carried_from(begin: Predicate) -> Predicate:
        void = since(let_go, reset=begin).called(
            f"{prop} was in the air, and not in both hands"
        )
        return since(
            (carried & ~void).called(f"both arms carry {prop} all the way"), reset=ended
        )

    # What both have carried over its place and lost there stands where both have brought it.
    brought = since(carried_from(on_table) & place, reset=on_table | ~place)
    on_the_way = carried_from(on_table | on_support & brought)
    # Put down beside its place, and pushed there by one arm, it was not brought there by both.
    low = low_over(prop, support, top)
    # Fingers open between two control steps: the object was lower than at the first one.
    nearly_low = low_over(prop, support, top, PUT_HEIGHT + HOP_HEIGHT)
    just_held = in_both | since(in_both & nearly_low, reset=~in_both)
    landed = all_of(
        low, raised(prop, top - LANDING_DEPTH), place, just_held, on_the_way
    )
    landed = landed.called(f"both arms put {prop} down on {support}")
    # Fingers that open make it hop, and what one hand lets go first tips onto its support.
    in_hand = grasped_by_any(*handles)
    hung = in_air & in_hand & ~in_both & ~low_over(prop, support, top, HOP_HEIGHT)
    taken_up = interrupted(~(in_air & in_hand) | low) | held_for(hung, TIP_SECONDS)
    taken_up = taken_up.called(f"{prop} is in one hand above {support}")
    put_down = since(landed, reset=on_table | taken_up)
    return Carriage(
        carried=carried,
        underway=on_the_way,
        put_down=put_down.told_of(f"when both hands last had {prop}", in_both),
    )
