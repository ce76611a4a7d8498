"""The words that stages are written in: one implementation of each.

Their logic, how they combine and what they remember, is in `stages.logic`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import hypot
from duobench.core.types import (
    LONGEST,
    SIDES,
    Side,
    check_unit,
)
from duobench.tasks.stages.logic import (
    Predicate,
    StateView,
    all_of,
    any_of,
    held_for,
    leaf,
    shared,
)
from duobench.world.objects.prop import MOST_TURNED
from duobench.world.scene.naming import TABLE
from duobench.world.sim.contacts import Touch, arm_owners, gripper_owners

Point = tuple[float, float, float]
HALF_TURN = 3.15
"""The largest angle between two axes, in radians, rounded up as people round it."""

STILL_SPEED = 0.05
STILL_ANGULAR_SPEED = 0.5
"""An object slower than this is still: m/s and rad/s."""
USUAL_WAY = 0.1
"""Way in metres, of a tool or of an object, from which on what is asked for is rather far than
near; for rewards alone."""
LIFTED_HEIGHT = 0.010
"""Least height in metres by which a lifted object is raised [task definitions]."""
SHUTTING_MOMENT = 2.0
"""Moment in N·m about a hinge from which on an arm turns a lid or a door shut: 14 N at the end of
the chest's lid, 6 N at the bar of the microwave's door."""
FLICKER_SECONDS = 0.1
"""From which time on a contact that is lost is lost for good, and one that should not be is no
graze: three control steps. Fingers that let go and close again take longer; when an arm jerks,
contacts flicker for a step or two. It is too short to hold a lid up."""


@shared
def interrupted(predicate: Predicate) -> Predicate:
    """It has not held for longer than a contact flickers."""
    return held_for(~predicate, FLICKER_SECONDS).called(f"no longer: {predicate.name}")


def check_metres(
    what: str,
    *lengths: object,
    endless: bool = False,
) -> None:
    """Reject what is too long to be a length in metres."""
    check_unit(
        what,
        "metres",
        LONGEST,
        *lengths,
        endless=endless,
    )


def mm(metres: float) -> str:
    """A length in words, in millimetres to a tenth."""
    return f"{round(metres * 1000, 1) + 0.0:g} mm"


def _reach(arm: Side, body: str) -> Callable[[StateView], float]:
    """Distance of a tool from a body, in usual distances."""
    return lambda state: state.simulation.reach(arm, body) / USUAL_WAY


@shared
def touches(arm: Side, body: str) -> Predicate:
    """A finger or the palm of that gripper is in contact with the body."""
    return leaf(
        f"{arm} touches {body}",
        lambda state: state.simulation.contacts.gripper(arm, body),
        touch=Touch(body, gripper_owners(arm), is_all=True),
        off=_reach(arm, body),
        otherwise=lambda _state: f"{arm} does not touch {body}",
    )


@shared
def arm_touches(arm: Side, body: str) -> Predicate:
    """Any part of that arm is in contact with the body: links and wrist camera too."""
    return leaf(
        f"{arm} arm touches {body}",
        lambda state: state.simulation.contacts.arm(arm, body),
        touch=Touch(body, arm_owners(arm), is_all=True),
        off=_reach(arm, body),
        otherwise=lambda _state: f"{arm} arm does not touch {body}",
    )


@shared
def grasped(arm: Side, body: str) -> Predicate:
    """Both fingers of that gripper press on the body, towards each other."""
    return leaf(
        f"{arm} grasps {body}",
        lambda state: state.simulation.contacts.grasped(arm, body),
        touch=Touch(body, gripper_owners(arm)),
        off=_reach(arm, body),
        otherwise=lambda _state: f"{arm} does not grasp {body}",
    )


@shared
def supports(arm: Side, lid: str) -> Predicate:
    """That arm keeps a lid or a door open: a contact of it pushes towards open, or it grasps it.

    A push counts with a lever of at least 20 mm about the hinge. A touch from outside, or one that
    presses it shut, supports nothing.

    Args:
        arm: Which arm; any part of it may push.
        lid: A body with a hinge of the same name.
    """

    def pushes(state: StateView) -> bool:
        sim = state.simulation
        return sim.contacts.pushes(arm, lid, lambda: sim.hinge_axis(lid))

    whole = grasped(arm, lid) | leaf(
        f"{arm} pushes {lid} open",
        pushes,
        touch=Touch(lid, arm_owners(arm)),
        off=_reach(arm, lid),
    )
    return whole.called(
        f"{arm} supports {lid}",
        lambda _state: f"{arm} neither pushes {lid} towards open nor grasps it",
    )


@shared
def backs(
    arm: Side,
    lid: str,
    distance: float,
) -> Predicate:
    """That gripper is where a lid or a door would turn onto it if it were let go.

    It is at most `distance` metres away, on the side from which it would push it open, inside the
    lid's outline along its normal.
    """
    check_metres("The distance of `backs`", distance)

    def test(state: StateView) -> bool:
        sim = state.simulation
        return any(sim.contacts.behind(arm, lid, sim.hinge_axis(lid), distance))

    return Predicate(f"{arm} is within {distance * 1000:.0f} mm behind {lid}", test)


@shared
def shuts(arm: Side, lid: str) -> Predicate:
    """That arm turns a lid or a door shut, which something else keeps open.

    All its contacts together have a moment about the hinge below minus `SHUTTING_MOMENT`.
    """

    def test(state: StateView) -> bool:
        sim = state.simulation
        return sim.contacts.moment(arm, lid, sim.hinge_axis(lid)) < -SHUTTING_MOMENT

    return Predicate(f"{arm} turns {lid} shut", test)


@shared
def grasped_by_any(*bodies: str) -> Predicate:
    """A gripper grasps one of these bodies."""
    whole = any_of(*(grasped(side, body) for side in SIDES for body in bodies))
    return whole.called(f"a gripper grasps {' or '.join(bodies)}")


@shared
def grasped_apart(one: str, other: str) -> Predicate:
    """Each gripper grasps one of two bodies, either way round."""
    either_way = (
        (grasped(side, one) & grasped(side.other, other)).called(
            f"{side} grasps {one} while {side.other} grasps {other}"
        )
        for side in SIDES
    )
    return any_of(*either_way).called(f"each gripper grasps one of {one} and {other}")


@shared
def off_table(body: str, *supports: str) -> Predicate:
    """Contact with neither the table nor any of these supports."""
    names = (TABLE, *supports)
    whole = ~any_of(*(touching(body, name) for name in names))
    return whole.called(f"{body} is off {', '.join(names)}")


@shared
def raised(prop: str, height: float) -> Predicate:
    """Its lowest point is at least `height` metres above where it was at the episode's start."""
    check_metres("The height of `raised`", height)

    def so_far(state: StateView) -> float:
        return state.min_height(prop) - state.start_heights[prop]

    def test(state: StateView) -> bool:
        limit = state.start_heights[prop] + height
        return state.height_near(prop, limit) >= limit

    return leaf(
        f"{prop} is raised by {height * 1000:.0f} mm",
        test,
        otherwise=lambda state: (
            f"{prop} is raised by {mm(so_far(state))}, not by {mm(height)}"
        ),
        off=lambda state: (height - so_far(state)) / height,
    )


@shared
def lifted(
    arm: Side,
    prop: str,
    *supports: str,
) -> Predicate:
    """Grasped by that arm, off table and supports, and raised by at least 10 mm.

    Args:
        arm: Which arm.
        prop: Name of a prop.
        supports: Names of further bodies that it must not be in contact with.
    """
    whole = all_of(
        grasped(arm, prop), off_table(prop, *supports), raised(prop, LIFTED_HEIGHT)
    )
    return whole.called(f"{arm} lifts {prop}")


@shared
def lifted_by_any(prop: str, *supports: str) -> Predicate:
    """Lifted by at least one arm; see `lifted`."""
    return any_of(*(lifted(side, prop, *supports) for side in SIDES)).called(
        f"an arm lifts {prop}"
    )


@shared
def released(body: str) -> Predicate:
    """Neither gripper is in contact with it."""

    def touching_it(state: StateView) -> list[Side]:
        return [side for side in SIDES if state.simulation.contacts.gripper(side, body)]

    return leaf(
        f"{body} is released",
        lambda state: state.simulation.contacts.released(body),
        touch=Touch(body, gripper_owners(*SIDES), is_all=True),
        otherwise=lambda state: (
            f"{' and '.join(touching_it(state))} still touches {body}"
        ),
    )


@shared
def still(prop: str) -> Predicate:
    """Slower than 0.05 m/s and 0.5 rad/s."""

    def test(state: StateView) -> bool:
        linear, angular = state.simulation.speed(prop)
        return (linear < STILL_SPEED) & (angular < STILL_ANGULAR_SPEED)

    def otherwise(state: StateView) -> str:
        linear, angular = state.simulation.speed(prop)
        return f"{prop} moves at {linear:.2f} m/s and {angular:.1f} rad/s"

    return leaf(f"{prop} is still", test, otherwise=otherwise)


@shared
def upright(prop: str, angle: float) -> Predicate:
    """Its up axis (z) is within `angle` radians of the world's."""
    check_unit("The angle of `upright`", "radians", HALF_TURN, angle)
    limit = math.cos(angle)

    def otherwise(state: StateView) -> str:
        tilt = math.degrees(math.acos(max(-1.0, state.simulation.axes(prop)[8])))
        return f"{prop} is tilted by {tilt:.1f} degrees, not at most {math.degrees(angle):.0f}"

    return leaf(
        f"{prop} is upright within {math.degrees(angle):.0f} degrees",
        lambda state: state.simulation.axes(prop)[8] >= limit,
        otherwise=otherwise,
        off=lambda state: limit - state.simulation.axes(prop)[8],
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class BoxRegion:
    """A box that is fixed to a body."""

    body: str
    """Body whose frame the box is given in."""
    low: tuple[float, float, float]
    """Lowest corner in metres."""
    high: tuple[float, float, float]
    """Highest corner in metres."""

    def __post_init__(self) -> None:
        check_metres(
            "A corner of a BoxRegion",
            *self.low,
            *self.high,
            endless=True,
        )

    def contains(self, point: Point) -> bool:
        """Whether a point of the body's frame, in metres, lies inside."""
        x, y, z = point
        (west, south, bottom), (east, north, top) = self.low, self.high
        in_outline = (west <= x) & (x <= east) & (south <= y) & (y <= north)
        return in_outline & (bottom <= z) & (z <= top)

    def distance(self, point: Point) -> float:
        """Distance in metres of a point of the body's frame from the inside; 0 inside."""
        return hypot(*map(_beyond, self.low, point, self.high))


@dataclass(frozen=True, kw_only=True, slots=True)
class CylinderRegion:
    """An upright cylinder that is fixed to a body, about its z axis or a line parallel to it."""

    body: str
    """Body whose frame the cylinder is given in."""
    radius: float
    """Radius in metres."""
    low: float
    """Bottom along z of the body's frame, in metres."""
    high: float
    """Top along z of the body's frame, in metres."""
    centre: tuple[float, float] = (0.0, 0.0)
    """Point at which the cylinder's axis crosses the x-y plane of the body, in metres."""

    def __post_init__(self) -> None:
        sizes = self.radius, self.low, self.high, *self.centre
        check_metres("A size of a CylinderRegion", *sizes, endless=True)

    def contains(self, point: Point) -> bool:
        """Whether a point of the body's frame, in metres, lies inside."""
        x, y, z = point
        offset = hypot(x - self.centre[0], y - self.centre[1])
        return (offset <= self.radius) & (self.low <= z) & (z <= self.high)

    def distance(self, point: Point) -> float:
        """Distance in metres of a point of the body's frame from the inside; 0 inside."""
        x, y, z = point
        offset = hypot(x - self.centre[0], y - self.centre[1])
        return hypot(_beyond(0.0, offset, self.radius), _beyond(self.low, z, self.high))


Region = BoxRegion | CylinderRegion


def _beyond(
    low: float,
    value: float,
    high: float,
) -> float:
    """Distance of a number from a range; 0 inside."""
    return np.maximum(np.maximum(low - value, value - high), 0.0)


@shared
def inside(prop: str, region: Region) -> Predicate:
    """Its centre (the origin of its frame) lies in a region that is fixed to another body."""

    def away(state: StateView) -> float:
        return region.distance(state.relative_position(prop, region.body))

    return leaf(
        f"{prop} is inside {region.body}",
        lambda state: region.contains(state.relative_position(prop, region.body)),
        otherwise=lambda state: (
            f"the centre of {prop} is {mm(away(state))} outside its place at {region.body}"
        ),
        off=lambda state: away(state) / USUAL_WAY,
    )


@shared
def touching(body: str, other: str) -> Predicate:
    """Two bodies are in contact."""
    return leaf(
        f"{body} touches {other}",
        lambda state: state.simulation.contacts.between(body, other),
        touch=Touch(body, (other,), is_all=True),
        otherwise=lambda _state: f"{body} does not touch {other}",
    )


@shared
def rests_on(prop: str, support: str) -> Predicate:
    """Contact with the support, not with the table, and at rest (see `still`)."""
    whole = all_of(touching(prop, support), ~touching(prop, TABLE), still(prop))
    return whole.called(f"{prop} rests on {support}")


@shared
def hinge_open(hinge: str, angle: float) -> Predicate:
    """A hinge is open by at least `angle` radians; its name is `<prop>/<part>`."""
    check_unit("The angle of `hinge_open`", "radians", MOST_TURNED, angle)
    return leaf(
        f"{hinge} is open by {angle:.2f} rad",
        lambda state: state.simulation.angle(hinge) >= angle,
        otherwise=lambda state: (
            f"{hinge} is open by {state.simulation.angle(hinge):.2f} rad, not by {angle:.2f}"
        ),
        off=lambda state: (angle - state.simulation.angle(hinge)) / angle,
    )


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
    repr=False,
)
class VariantIs(Predicate):
    """A named choice of the layout."""

    choice: str
    value: str

    def possible(self, state: StateView) -> bool:
        """Whether the episode's layout chose it."""
        return self.ask(state)


@shared
def variant(name: str, value: str) -> Predicate:
    """The episode's layout chose this value, such as which cup is full."""
    return VariantIs(
        f"{name} is {value}",
        lambda state: state.variants.get(name) == value,
        otherwise=lambda state: f"{name} is {state.variants.get(name)}, not {value}",
        vectorized=True,
        choice=name,
        value=value,
        looks=False,
    )


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
    repr=False,
)
class AtLeast(Predicate):
    """Some of its parts hold."""

    count: int
    """Least number of predicates."""


@shared
def at_least(count: int, *predicates: Predicate) -> Predicate:
    """At least `count` of them hold."""
    names = ", ".join(p.name for p in predicates)
    asks = tuple(p.ask for p in predicates)
    return AtLeast(
        f"at least {count} of ({names})",
        lambda state: sum([ask(state) for ask in asks]) >= count,
        predicates,
        count=count,
        looks=False,
    )
