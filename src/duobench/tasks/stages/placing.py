"""Placing: conditions for an object to be put down in its place, not dropped, and left there.

No hand lets go at the exact step of the first contact, so a place has some height: what is let go
there is put down, what is let go above it is dropped. A vessel is what one drops things into: its
place is higher. And what is let go has to stay: half a second of rest without a hand tells what
stands from what topples, rolls off or drops through.
"""

from duobench.core.types import SIDES, Side
from duobench.tasks.stages.logic import (
    Predicate,
    StateView,
    all_of,
    any_of,
    held_for,
    leaf,
    shared,
    since,
)
from duobench.tasks.stages.predicates import (
    LIFTED_HEIGHT,
    USUAL_WAY,
    arm_touches,
    check_metres,
    grasped,
    mm,
    released,
    still,
)
from duobench.world.scene.naming import TABLE

PUT_HEIGHT = 0.012
"""How high above what it is to stand on the lowest point of an object may be when it is let go, in
metres: 10 mm [task definitions], and 2 mm that a hand on its way down, which is seen at control
steps alone, still comes nearer while its fingers open. Arms that are told to stop at a height stop
3 to 4 mm higher, and 7 mm where they tremble (measured)."""
DROP_HEIGHT = 0.060
"""How high above a vessel's rim, or the floor that a hand under a roof reaches aslant, it may be,
in metres: no coordination is avoided by some centimetres of air [task definitions]."""
REST_SECONDS = 0.5
"""Seconds that an object has to rest where it was put [task definitions]."""


@shared
def low_over(
    prop: str,
    body: str,
    top: float,
    height: float = PUT_HEIGHT,
) -> Predicate:
    """Its lowest point is at most `height` metres above the top of a body.

    Args:
        prop: The object.
        body: What is below it. It may be tilted: the top is taken right below the object's centre.
        top: Height of the top in the body's frame, in metres.
        height: How far above it, in metres.
    """
    check_metres("A height of `low_over`", top, height)

    def level(state: StateView) -> float:
        if body == TABLE:
            return top
        sim = state.simulation
        x, y, _ = state.relative_position(prop, body)
        up_x, up_y, up_z = sim.axes(body)[6:]
        return sim.origin(body)[2] + up_x * x + up_y * y + up_z * top

    def gap(state: StateView) -> float:
        return state.min_height(prop) - level(state)

    def test(state: StateView) -> bool:
        lowest = level(state)
        return state.height_near(prop, lowest + height) - lowest <= height

    return leaf(
        f"{prop} is at most {height * 1000:.0f} mm above {body}",
        test,
        otherwise=lambda state: (
            f"{prop} is {mm(gap(state))} above {body}, not at most {mm(height)}"
        ),
        off=lambda state: (gap(state) - height) / USUAL_WAY,
    )


@shared
def lifted_off(
    prop: str,
    body: str,
    top: float,
) -> Predicate:
    """It is in the air again: its lowest point is more than 10 mm above the top of a body.

    Args:
        prop: The object.
        body: What it lay on or in.
        top: Height of the top, or of a vessel's floor, in the body's frame, in metres.
    """
    return ~low_over(prop, body, top, LIFTED_HEIGHT)


@shared
def put(
    prop: str, there: Predicate, *sides: Side, again: Predicate | None = None
) -> Predicate:
    """A gripper has let go of it at its place, or holds it there, and there it has been since.

    A hand has brought it there: what was dropped from above is not put by a hand that grasps it
    where it lies, until it has lifted it again.

    Args:
        prop: The object.
        there: It is at its place, or so little above that it is put down when it is let go.
        sides: The grippers that may have done so; either where none is given.
        again: It is lifted off what it lies on, though still there, as in a vessel.
    """
    hand = f"the {sides[0]} gripper" if len(sides) == 1 else "a gripper"
    in_hand = any_of(*(grasped(side, prop) for side in sides or SIDES))
    away = ~there if again is None else ~there | again
    carrying = (in_hand & away).called(f"{hand} carries {prop}")
    dropped = (released(prop) & ~there).called(f"{prop} was dropped")
    carried = since(carrying, reset=dropped).called(f"{hand} has carried {prop} there")
    event = (in_hand & there & carried).called(f"{hand} has {prop} at its place")
    return since(event, reset=~there).told_of(f"when {hand} let {prop} go", in_hand)


def left_alone(*props: str) -> Predicate:
    """All are still, and no arm props any of them up, with its gripper or with any other part."""
    untouched = (~arm_touches(side, prop) for prop in props for side in SIDES)
    return all_of(*map(still, props), *untouched)


def placed(*conditions: Predicate) -> Predicate:
    """All of them have held for half a second without a break."""
    return held_for(
        all_of(*conditions).called("all is at rest in its place"), REST_SECONDS
    )
