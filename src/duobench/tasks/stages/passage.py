"""Through a ring: which way an object came from one side of a gate to the other.

The gate is a plane that is fixed to a body, with a hole in it. An object that has just changed
sides is in front of the hole or beside it: that tells the ways apart. What was led around the gate
and backwards through the hole has not come through when it is pulled out again.
"""

from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import hypot
from duobench.tasks.stages.logic import (
    Predicate,
    StateView,
    all_of,
    leaf,
    since,
)
from duobench.tasks.stages.predicates import USUAL_WAY, mm

EXIT_DEPTH = 0.05
"""How far from the plane, in metres, an object is still in front of the hole. It is more than an
object moves in one control step at 1.4 m/s."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Hole:
    """A hole in the x-z plane of a body, passed in the direction of y."""

    body: str
    height: float
    """Height of the hole's centre in the body's frame, in metres."""
    radius: float
    """Largest distance from the centre at which an object's own centre may pass, in metres."""
    rim: float
    """Distance of the hole's edge from the centre, in metres: beyond it, the way leads around."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Passage:
    """Predicates about an object and a hole; made by `passage`."""

    crossing: Predicate
    """It comes through the hole, at this step, held."""
    through: Predicate
    """It is on the far side, and came there through the hole, held, not around."""
    within: Predicate
    """Its middle is in the hole, less than half its length from the plane."""


def passage(
    prop: str,
    hole: Hole,
    *,
    length: float,
    held: Predicate,
) -> Passage:
    """The predicates for an object that starts on the near side (negative y) of a hole.

    Args:
        prop: The object.
        hole: The hole.
        length: Length of the object in metres.
        held: What must hold when the object comes through, at that step or at the one before.
    """

    def where(state: StateView) -> tuple[float, float]:
        """Distance beyond the plane, and from the hole's axis, in metres."""
        x, y, z = state.relative_position(prop, hole.body)
        return y, hypot(x, z - hole.height)

    def in_front(radius: float, depth: float = EXIT_DEPTH) -> Predicate:
        def test(state: StateView) -> bool:
            beyond, off_axis = where(state)
            return (abs(beyond) <= depth) & (off_axis <= radius)

        def off(state: StateView) -> float:
            beyond, off_axis = where(state)
            away = (
                np.maximum(abs(beyond) - depth, 0.0),
                np.maximum(off_axis - radius, 0.0),
            )
            return hypot(*away) / USUAL_WAY

        def otherwise(state: StateView) -> str:
            beyond, off_axis = where(state)
            side = "behind" if beyond >= 0 else "before"
            return f"{prop} is {mm(abs(beyond))} {side} {hole.body} and {mm(off_axis)} off its axis"

        return leaf(
            f"{prop} is within {radius * 1000:.0f} mm of the axis of {hole.body}, "
            f"{depth * 1000:.0f} mm before or behind it",
            test,
            otherwise=otherwise,
            off=off,
        )

    near = leaf(
        f"{prop} is on the near side of {hole.body}",
        lambda state: where(state)[0] < 0,
        otherwise=lambda _state: f"{prop} is on the far side of {hole.body}",
    )
    # Forgotten at the step after: what held at the step before this one.
    was_near, was_far = since(near, reset=~near), since(~near, reset=near)
    was_held = since(held, reset=~held)
    in_hole = in_front(hole.rim)
    led_around = since(
        all_of(~near, was_near, ~in_hole).called(f"{prop} comes around {hole.body}"),
        reset=all_of(near, was_far, ~in_hole),
    ).called(f"{prop} has come around {hole.body}")
    crossing = all_of(
        ~near, was_near, in_front(hole.radius), ~led_around, held | was_held
    )
    crossing = crossing.called(f"{prop} crosses {hole.body}")
    came_through = since(crossing, reset=near).called(f"{prop} has crossed {hole.body}")
    return Passage(
        crossing=crossing,
        through=all_of(~near, crossing | came_through),
        within=in_front(hole.rim, length / 2),
    )
