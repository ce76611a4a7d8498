"""The words that stages are written in: one implementation of each.

A predicate is a pure question about one `StateView`. Predicates combine with `&`, `|` and `~`; the
only memories are `since(p, reset=q)`, which can be forgotten, and, for "still for half a second",
`held_for(p, seconds)`. They are kept by `stages.progress`. That two hands were there once says
nothing: where coordination is the point, ask for it at the moment that matters, or forget it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from duobench.scene.naming import TABLE
from duobench.types import CONTROL_HZ, SIDES, Side

if TYPE_CHECKING:
    from duobench.sim.simulation import Simulation

Point = tuple[float, float, float]
Memory = tuple["Predicate", ...]
"""What is remembered and, if anything makes it forgotten, what does."""

STILL_SPEED = 0.05
STILL_ANGULAR_SPEED = 0.5
"""An object slower than this is still: m/s and rad/s."""
LIFTED_HEIGHT = 0.010
"""How far a lifted object is raised at least, in metres [task definitions]."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class StateView:
    """One control step as predicates see it."""

    simulation: Simulation
    """The simulation, whose contacts are those of this step."""
    start_heights: dict[str, float]
    """Height of each prop's lowest point when the episode began, in metres."""
    variants: Mapping[str, str]
    """The layout's named choices."""
    remembered: frozenset[Memory]
    """What held at an earlier step of this episode and is not forgotten."""
    lasted: Mapping[Predicate, int] = field(default_factory=dict)
    """For how many control steps in a row a predicate has held, this one included."""
    answers: dict[Predicate, bool] = field(default_factory=dict)
    """Answers so far: a predicate is pure, so it is tested once a control step."""


@dataclass(frozen=True, slots=True, eq=False)
class Predicate:
    """A named pure question about a control step."""

    name: str
    """The question in words, for messages."""
    test: Callable[[StateView], bool]
    """Answers it, from the view alone; other predicates in it must be in `parts`."""
    parts: tuple[Predicate, ...] = field(default=())
    """The predicates that `test` calls: `since` and `held_for` in them are remembered."""
    ask: Callable[[StateView], bool] = field(init=False, repr=False)
    """The same as a call, as a plain function, which Python calls in half the time."""

    def __post_init__(self) -> None:
        """Make the function that asks at most once a control step."""
        test = self.test

        def ask(moment: StateView) -> bool:
            answer = moment.answers.get(self)
            if answer is None:
                answer = moment.answers[self] = test(moment)
            return answer

        object.__setattr__(self, "ask", ask)

    def __call__(self, moment: StateView) -> bool:
        """Whether it holds."""
        return self.ask(moment)

    def __and__(self, other: Predicate) -> Predicate:
        """Both hold."""
        return all_of(self, other)

    def __or__(self, other: Predicate) -> Predicate:
        """At least one holds."""
        return any_of(self, other)

    def __invert__(self) -> Predicate:
        """It does not hold."""
        one = self.ask
        return Predicate(f"not {self.name}", lambda m: not one(m), (self,))

    def __repr__(self) -> str:
        """The predicate in words."""
        return self.name

    def walk(self) -> Iterator[Predicate]:
        """This predicate and all it is made of, each once, inner ones first."""
        inner: dict[Predicate, None] = {}
        self._collect(inner)
        yield from inner

    def _collect(self, inner: dict[Predicate, None]) -> None:
        if self not in inner:
            for part in self.parts:
                part._collect(inner)
            inner[self] = None


class Since(Predicate):
    """A predicate that held at an earlier step of the episode; its parts are its `Memory`."""

    __slots__ = ()


def since(predicate: Predicate, *, reset: Predicate | None = None) -> Predicate:
    """`predicate` held at some earlier step of this episode, and `reset` has not held since.

    Args:
        predicate: What is remembered.
        reset: What makes it forgotten, if anything: it held at none of the steps from the one that
            is remembered to the last one. So `since(left, reset=right)` is true where the last of
            the two that held was `left`.
    """
    memory: Memory = (predicate,) if reset is None else (predicate, reset)
    name = f"since {predicate.name}" + ("" if reset is None else f" without {reset.name}")
    return Since(name, lambda m: memory in m.remembered, memory)


class HeldFor(Predicate):
    """A predicate that has held for some time without a break."""

    __slots__ = ()


def held_for(predicate: Predicate, seconds: float) -> Predicate:
    """`predicate` holds, and has held at every control step of the last `seconds`.

    Args:
        predicate: What must hold.
        seconds: For how long, rounded to control steps of 1/30 s.
    """
    steps = round(seconds * CONTROL_HZ)
    return HeldFor(
        f"{predicate.name} for {seconds:g} s",
        lambda m: m.lasted.get(predicate, 0) >= steps,
        (predicate,),
    )


def all_of(*predicates: Predicate) -> Predicate:
    """All hold."""
    name = " and ".join(p.name for p in predicates)
    asks = tuple(p.ask for p in predicates)

    def test(m: StateView) -> bool:
        for ask in asks:  # noqa: SIM110 - a third of the time of a generator
            if not ask(m):
                return False
        return True

    return Predicate(f"({name})", test, predicates)


def any_of(*predicates: Predicate) -> Predicate:
    """At least one holds."""
    name = " or ".join(p.name for p in predicates)
    asks = tuple(p.ask for p in predicates)

    def test(m: StateView) -> bool:
        for ask in asks:  # noqa: SIM110 - a third of the time of a generator
            if ask(m):
                return True
        return False

    return Predicate(f"({name})", test, predicates)


def at_least(count: int, *predicates: Predicate) -> Predicate:
    """At least `count` of them hold."""
    names = ", ".join(p.name for p in predicates)
    asks = tuple(p.ask for p in predicates)
    return Predicate(
        f"at least {count} of ({names})",
        lambda m: sum([ask(m) for ask in asks]) >= count,
        predicates,
    )


def touches(arm: Side, body: str) -> Predicate:
    """A finger or the palm of that gripper is in contact with the body."""
    return Predicate(f"{arm} touches {body}", lambda m: m.simulation.contacts.gripper(arm, body))


def arm_touches(arm: Side, body: str) -> Predicate:
    """Any part of that arm is in contact with the body: links and wrist camera too."""
    return Predicate(f"{arm} arm touches {body}", lambda m: m.simulation.contacts.arm(arm, body))


def near(arm: Side, body: str, distance: float) -> Predicate:
    """A finger or the palm of that gripper is at most `distance` metres from the body."""
    return Predicate(
        f"{arm} is within {distance * 1000:.0f} mm of {body}",
        lambda m: m.simulation.contacts.near(arm, body, distance),
    )


def grasped(arm: Side, body: str) -> Predicate:
    """Both fingers of that gripper press on the body, towards each other."""
    return Predicate(f"{arm} grasps {body}", lambda m: m.simulation.contacts.grasped(arm, body))


def grasped_apart(one: str, other: str) -> Predicate:
    """Each gripper grasps one of two bodies, either way round."""
    return any_of(*(grasped(side, one) & grasped(side.other, other) for side in SIDES))


def off_table(body: str, *supports: str) -> Predicate:
    """In contact with neither the table nor any of these supports."""
    names = (TABLE, *supports)
    whole = ~any_of(*(touching(body, name) for name in names))
    return Predicate(f"{body} is off {', '.join(names)}", whole.test, whole.parts)


def raised(prop: str, height: float) -> Predicate:
    """Its lowest point is at least `height` metres above where it was at the episode's start."""
    return Predicate(
        f"{prop} is raised by {height * 1000:.0f} mm",
        lambda m: m.simulation.min_height(prop) >= m.start_heights[prop] + height,
    )


def lifted(arm: Side, prop: str, *supports: str) -> Predicate:
    """Grasped by that arm, off table and supports, and raised by at least 10 mm.

    Args:
        arm: Which arm.
        prop: Name of a prop.
        supports: Names of further bodies that it must not be in contact with.
    """
    whole = all_of(grasped(arm, prop), off_table(prop, *supports), raised(prop, LIFTED_HEIGHT))
    return Predicate(f"{arm} lifts {prop}", whole.test, whole.parts)


def lifted_by_any(prop: str, *supports: str) -> Predicate:
    """Lifted by at least one arm; see `lifted`."""
    return any_of(*(lifted(side, prop, *supports) for side in SIDES))


def released(body: str) -> Predicate:
    """Neither gripper is in contact with it."""
    return Predicate(
        f"{body} is released",
        lambda m: not any(m.simulation.contacts.gripper(side, body) for side in SIDES),
    )


def still(prop: str) -> Predicate:
    """Slower than 0.05 m/s and 0.5 rad/s."""

    def test(m: StateView) -> bool:
        linear, angular = m.simulation.speed(prop)
        return linear < STILL_SPEED and angular < STILL_ANGULAR_SPEED

    return Predicate(f"{prop} is still", test)


def upright(prop: str, angle: float) -> Predicate:
    """Its up axis (z) is within `angle` radians of the world's."""
    limit = math.cos(angle)
    return Predicate(
        f"{prop} is upright within {math.degrees(angle):.0f} degrees",
        lambda m: float(m.simulation.rotation(prop)[2, 2]) >= limit,
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

    def contains(self, point: Point) -> bool:
        """Whether a point of the body's frame, in metres, lies inside."""
        return all(
            low <= value <= high
            for low, value, high in zip(self.low, point, self.high, strict=True)
        )


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
    """Where the cylinder's axis crosses the x-y plane of the body, in metres."""

    def contains(self, point: Point) -> bool:
        """Whether a point of the body's frame, in metres, lies inside."""
        x, y, z = point
        offset = math.dist((x, y), self.centre)
        return offset <= self.radius and self.low <= z <= self.high


Region = BoxRegion | CylinderRegion


def inside(prop: str, region: Region) -> Predicate:
    """Its centre (the origin of its frame) lies in a region that is fixed to another body."""
    return Predicate(
        f"{prop} is inside {region.body}",
        lambda m: region.contains(m.simulation.relative_position(prop, region.body)),
    )


def touching(body: str, other: str) -> Predicate:
    """Two bodies are in contact."""
    return Predicate(
        f"{body} touches {other}", lambda m: m.simulation.contacts.between(body, other)
    )


def rests_on(prop: str, support: str) -> Predicate:
    """In contact with the support, not with the table, and still (see `still`)."""
    whole = all_of(touching(prop, support), ~touching(prop, TABLE), still(prop))
    return Predicate(f"{prop} rests on {support}", whole.test, whole.parts)


def hinge_open(hinge: str, angle: float) -> Predicate:
    """A hinge is open by at least `angle` radians; its name is `<prop>/<part>`."""
    return Predicate(
        f"{hinge} is open by {angle:.2f} rad", lambda m: m.simulation.angle(hinge) >= angle
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False, repr=False)
class VariantIs(Predicate):
    """A named choice of the layout."""

    choice: str
    """Name of the choice."""
    value: str
    """Value that was chosen."""


def variant(name: str, value: str) -> Predicate:
    """The episode's layout chose this value, such as which cup is full."""
    return VariantIs(
        f"{name} is {value}", lambda m: m.variants.get(name) == value, choice=name, value=value
    )
