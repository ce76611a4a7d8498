"""Through a ring: which way an object came from one side of a gate to the other.

The gate is a plane that is fixed to a body, with a hole in it. An object that reaches the far side
is at first either in front of the hole or beside it: that tells the two ways apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from duobench.stages.predicates import Moment, Predicate, all_of, since

EXIT_DEPTH = 0.05
"""How far beyond the plane, in metres, an object is still in front of the hole. It is more than an
object moves in one control step at 1.5 m/s."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Hole:
    """A hole in the x-z plane of a body, passed in the direction of y."""

    body: str
    """The body."""
    height: float
    """Height of the hole's centre in the body's frame, in metres."""
    radius: float
    """How far from the centre an object's own centre may be, in metres."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Passage:
    """Predicates about an object and a hole; made by `passage`."""

    crossing: Predicate
    """It has just come through the hole, and is still in front of it."""
    through: Predicate
    """It is on the far side, and came there through the hole, not around."""


def passage(prop: str, hole: Hole) -> Passage:
    """The predicates for an object that starts on the near side (negative y) of a hole."""

    def where(m: Moment) -> tuple[float, float]:
        """Distance beyond the plane, and from the hole's axis, in metres."""
        x, y, z = m.simulation.offset(prop, hole.body)
        return y, math.hypot(x, z - hole.height)

    def in_front(m: Moment) -> bool:
        beyond, off_axis = where(m)
        return beyond <= EXIT_DEPTH and off_axis <= hole.radius

    near = Predicate(f"{prop} is on the near side of {hole.body}", lambda m: where(m)[0] < 0)
    at_exit = ~near & Predicate(f"{prop} is in front of the hole of {hole.body}", in_front)
    beside = ~near & ~at_exit
    crossing = at_exit & since(near, reset=beside)
    around = beside & since(near, reset=at_exit)
    came_through = since(crossing, reset=around)
    return Passage(
        crossing=Predicate(f"{prop} crosses {hole.body}", crossing.test, crossing.parts),
        through=all_of(~near, ~around, crossing | came_through),
    )
