"""Logic of stages: predicates, their combinations, and their memory.

A predicate is a pure question about one `StateView`. Predicates combine with `&`, `|` and `~`; the
only memories are `since(p, reset=q)`, which can be forgotten, and, for "still for half a second" or
"for a second in all", `held_for(p, seconds)`. They are kept by `stages.progress`. That two hands
were there once says nothing: where coordination is the point, ask for it at the moment that
matters, or forget it.

A predicate that does not hold says why in words, with `unmet`, on demand.
"""

from __future__ import annotations

import math
from collections.abc import (
    Callable,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import (
    TYPE_CHECKING,
    Any,
    NoReturn,
    ParamSpec,
    Self,
    TypeVar,
    cast,
)

from duobench.core.errors import TaskError
from duobench.core.types import CONTROL_HZ
from duobench.world.sim.contacts import Touch
from duobench.world.sim.questions import CLEARLY

if TYPE_CHECKING:
    from duobench.world.sim.simulation import Simulation

P = ParamSpec("P")
R = TypeVar("R", bound="Predicate")
Found = TypeVar("Found")

Words = tuple[str, ...]
"""Statements, one constraint each."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Memory:
    """Memory of a `since`."""

    event: Predicate
    """Event of an earlier step."""
    reset: Predicate | None
    """Predicate that clears the memory, if any."""
    number: Number | None = None
    """Number of which it is a binary digit, if it is one."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Number:
    """A number that is remembered in binary digits, as `kept` does."""

    units: Callable[[StateView], float]
    """Function that gives its whole units at a step."""
    when: Predicate
    """Predicate of the steps at which it is remembered anew."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class StepClock:
    """Counter of the control steps at which a predicate holds."""

    of: Predicate
    """Predicate that holds at a step that counts."""
    reset: Predicate | None = None
    """Predicate that sets it back to 0; None is every step at which `of` does not hold."""

    def counts(self, state: StateView) -> bool | None:
        """Whether it counts a step; None for one that sets it back to 0."""
        if self.reset is None:
            return True if self.of.ask(state) else None
        return None if self.reset.ask(state) else self.of.ask(state)


@dataclass(kw_only=True, slots=True, eq=False)
class StateView:
    """One control step as predicates see it, who change nothing of it."""

    simulation: Simulation
    """The simulation, whose contacts are those of this step.

    It answers `position(body)` and `pose(body)` in the table frame, in metres, `min_height(prop)`,
    `relative_position(body, frame)`, `speed(prop)` as m/s and rad/s, `angle(hinge)` in radians, and
    `contacts.grasped(side, prop)`, `contacts.between(one, other)`.
    """
    start_heights: dict[str, float]
    """Height of each prop's lowest point when the episode began, in metres."""
    variants: Mapping[str, str]
    remembered: frozenset[Memory]
    """Memories of earlier steps of this episode that are not cleared."""
    lasted: Mapping[StepClock, int] = field(default_factory=dict[StepClock, int])
    """Control steps that each clock has counted, this one included."""
    past: Mapping[Memory, str] = field(default_factory=dict[Memory, str])
    """Reasons from earlier steps why something is not remembered; for explanations alone."""
    answers: dict[Predicate, bool] = field(default_factory=dict)
    """Answers so far of predicates that look: they are pure, so each is tested once a step."""
    conclusions: dict[Predicate, bool] = field(default_factory=dict)
    """Answers so far of the others, which follow from those and from what is remembered."""
    _found: dict[object, Any] = field(default_factory=dict)
    """Values computed of poses so far."""

    def begin(
        self,
        simulation: Simulation,
        remembered: frozenset[Memory],
        lasted: Mapping[StepClock, int],
    ) -> None:
        """See the next step of the same episode."""
        self.simulation = simulation
        self.remembered = remembered
        self.lasted = lasted
        self.answers = {}
        self.conclusions = {}
        self._found = {}

    def relative_position(self, body: str, frame: str) -> tuple[float, float, float]:
        """Origin of a body in the frame of another body, in metres, computed once."""
        found = self._found.get((body, frame))
        if found is None:
            found = self._found[body, frame] = self.simulation.relative_position(
                body, frame
            )
        return found

    def once(self, key: object, question: Callable[[Simulation], Found]) -> Found:
        """Answer of the simulation to a question that has a key, asked once."""
        found = self._found.get(key)
        if found is None:
            found = self._found[key] = question(self.simulation)
        return found

    def min_height(self, prop: str) -> float:
        """Height of a prop's lowest point above the table top, in metres, computed once."""
        found = self._found.get(prop)
        if found is None:
            found = self._found[prop] = self.simulation.min_height(prop)
        return found

    def height_near(self, prop: str, limit: float) -> float:
        """`min_height`, or a bound of it that is clearly on the same side of a limit."""
        found = self._found
        if prop in found:
            return found[prop]
        bounds = found.get((prop,))
        if bounds is None:
            bounds = found[prop,] = self.simulation.height_bounds(prop)
            if bounds is None:
                return self.min_height(prop)
        lowest, highest = bounds
        if highest < limit - CLEARLY:
            return highest
        return lowest if lowest > limit + CLEARLY else self.min_height(prop)


@dataclass(frozen=True, slots=True, eq=False)
class Predicate:
    """Named condition on a control step; evaluating it changes nothing."""

    name: str
    """Condition as a short sentence: "left grasps cube"."""
    test: Callable[[StateView], bool]
    """Function that evaluates it from the view alone; predicates in it must be in `parts`."""
    parts: tuple[Predicate, ...] = field(default=())
    """Predicates that `test` calls; the memory of `since` and `held_for` among them is kept."""
    otherwise: Callable[[StateView], str] | None = field(default=None, repr=False)
    """Explanation of a failure, as a short sentence with the number that was missed:
    "cube is raised by 4 mm, not by 10 mm"."""
    off: Callable[[StateView], float] | None = field(default=None, repr=False)
    """Distance from holding, in usual distances: near 0 it almost holds. For rewards alone, see
    `stages.nearness`; it accepts many simulations if `test` does."""
    vectorized: bool = field(default=False, repr=False)
    """Whether `test` also accepts a view of n simulations, whose numbers are arrays (n,), and
    returns booleans (n,): it uses `&` and comparisons, not `and`, `if` or `float`."""
    looks: bool = field(default=True, repr=False)
    """Whether `test` reads the simulation or a clock, so that its value may change while layout,
    memory and the values of all parts stay the same."""
    touch: Touch | None = field(default=None, repr=False)
    """Contacts on which its value depends, if it is about some."""
    ask: Callable[[StateView], bool] = field(init=False, repr=False)
    """Same as calling the predicate, as a plain function, which Python calls in half the time."""
    cost: int = field(init=False, repr=False)
    """What the first look takes: 0 where all is remembered, 1 for contacts and 2 for poses."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "cost", self._first_cost())
        test = self.test

        def look(state: StateView) -> bool:
            answer = state.answers.get(self)
            if answer is None:
                answer = state.answers[self] = test(state)
            return answer

        def conclude(state: StateView) -> bool:
            answer = state.conclusions.get(self)
            if answer is None:
                answer = state.conclusions[self] = test(state)
            return answer

        object.__setattr__(self, "ask", look if self.looks else conclude)

    def _first_cost(self) -> int:
        if self.touch is not None:
            return 1
        return 2 if self.looks else min((part.cost for part in self.parts), default=0)

    def __call__(self, state: StateView) -> bool:
        """Whether it holds."""
        return self.ask(state)

    def __and__(self, other: Predicate) -> Predicate:
        return all_of(self, other)

    def __or__(self, other: Predicate) -> Predicate:
        return any_of(self, other)

    def __invert__(self) -> Predicate:
        return _not(self)

    def __bool__(self) -> NoReturn:
        raise TaskError(
            f"{self.name!r} is asked at every step, and is neither true nor false by itself: "
            "combine predicates with &, | and ~, not with `and`, `or` and `not`."
        )

    def __repr__(self) -> str:
        return self.name

    def called(
        self, name: str, otherwise: Callable[[StateView], str] | None = None
    ) -> Self:
        """The same question in other words, for messages."""
        return replace(self, name=name, otherwise=otherwise or self.otherwise)

    def unmet(self, state: StateView) -> Words:
        """Reasons why it does not hold: its constraints that do not; empty if it holds."""
        return () if self.ask(state) else self.why(state)

    def why(self, state: StateView) -> Words:
        """Reasons why it holds or does not."""
        if self.ask(state):
            return self._met(state)
        return (self.otherwise(state),) if self.otherwise else self._unmet(state)

    def possible(self, state: StateView) -> bool:  # noqa: ARG002 - variants differ
        """Whether it can ever hold in the episode's layout."""
        return True

    def begun(self, state: StateView) -> bool:
        """Whether an earlier step tells why it does not hold: an alternative that was tried."""
        return any(part.begun(state) for part in self.parts)

    def _unmet(self, state: StateView) -> Words:  # noqa: ARG002 - what has parts differs
        return (f"it is not so that {self.name}",)

    def _met(self, state: StateView) -> Words:  # noqa: ARG002 - negations differ
        return (self.name,)

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


leaf = partial(Predicate, vectorized=True)
"""A predicate about one step that takes many simulations at once."""


def shared(word: Callable[P, R]) -> Callable[P, R]:
    """Make a word give one and the same predicate for the same arguments.

    Stages ask the same in many places; what is one predicate is tested once a control step.
    """
    return cast("Callable[P, R]", cache(word))


class Not(Predicate):
    """Negation of a predicate."""

    __slots__ = ()

    def _unmet(self, state: StateView) -> Words:
        return self.parts[0].why(state)

    _met = _unmet


class AllOf(Predicate):
    """Each part that does not hold speaks for itself."""

    __slots__ = ()

    def possible(self, state: StateView) -> bool:
        """Whether all of them can hold."""
        return all(part.possible(state) for part in self.parts)

    def _unmet(self, state: StateView) -> Words:
        return _each_once(part.unmet(state) for part in self.parts)


class AnyOf(Predicate):
    """Says what all alternatives lack, and that none of them holds."""

    __slots__ = ()

    def possible(self, state: StateView) -> bool:
        """Whether one of them can hold."""
        return any(part.possible(state) for part in self.parts)

    def _unmet(self, state: StateView) -> Words:
        alternatives = [part for part in self._alternatives() if part.possible(state)]
        alternatives = [
            part for part in alternatives if part.begun(state)
        ] or alternatives
        if not alternatives:
            return (f"in this layout it cannot be that {self.name}",)
        reasons = [part.unmet(state) for part in alternatives]
        shared = tuple(
            reason for reason in reasons[0] if all(reason in own for own in reasons)
        )
        if any(len(own) == len(shared) for own in reasons):
            return shared
        names: list[str] = []
        for part, own in zip(alternatives, reasons, strict=True):
            more = "; ".join(reason for reason in own if reason not in shared)
            names.append(f"{part.name} ({more})" if part.begun(state) else part.name)
        names = list(dict.fromkeys(names))
        start = "neither " if len(names) > 1 else "it is not so that "
        return (*shared, start + " nor ".join(names))

    def _met(self, state: StateView) -> Words:
        return _each_once(part.why(state) for part in self.parts if part.ask(state))

    def _alternatives(self) -> Iterator[Predicate]:
        for part in self.parts:
            if isinstance(part, AnyOf):
                yield from part._alternatives()
            else:
                yield part


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
    repr=False,
)
class Since(Predicate):
    """A predicate that held at an earlier step of the episode."""

    memory: Memory
    when: str = ""
    """Words of an explanation for the last step at which `at` held: "when cube was let go"."""
    at: Predicate | None = None
    """Predicate of a moment: an explanation tells of the last step at which this held."""

    def told_of(self, when: str, at: Predicate) -> Since:
        """The same, explained by what was missing at the last step at which `at` held."""
        return replace(self, when=when, at=at)

    def begun(self, state: StateView) -> bool:
        """Whether it was remembered, or could have been."""
        return self.memory in state.past or self.ask(state) or self._now(state)

    def _first_cost(self) -> int:
        return 0

    def _now(self, state: StateView) -> bool:
        return self.at is not None and self.at.ask(state)

    def _unmet(self, state: StateView) -> Words:
        event = self.memory.event
        if self._now(state) and not event.ask(state):
            return event.unmet(state)
        why = state.past.get(self.memory)
        if why:
            return (why,)
        # What is made of memories is explained by them.
        return (event.begun(state) and event.unmet(state)) or (
            f"not so far: {event.name}",
        )

    def look_back(self, state: StateView, remembered: frozenset[Memory]) -> str | None:
        """Reason why it is not remembered after this step, if the step shows it.

        Args:
            state: The step.
            remembered: What is remembered after it.
        """
        event, reset = self.memory.event, self.memory.reset
        if self.memory in remembered:
            return None
        if self.memory in state.remembered and reset is not None:
            return f"undone: {event.name} ({', '.join(reset.why(state))})"
        if self._now(state):
            missing = event.unmet(state) or (() if reset is None else reset.why(state))
            return f"{self.when}: {', '.join(missing)}"
        return state.past.get(self.memory)


@shared
def since(
    predicate: Predicate,
    *,
    reset: Predicate | None = None,
    number: Number | None = None,
) -> Since:
    """`predicate` held at some earlier step of this episode, and `reset` has not held since.

    Args:
        predicate: What is remembered.
        reset: What makes it forgotten, if anything: it held at none of the steps from the one that
            is remembered to the last one. So `since(left, reset=right)` is true where the last of
            the two that held was `left`.
        number: The number of which it is a binary digit, if it is one; `Progress` remembers all
            digits of it at once.
    """
    memory = Memory(event=predicate, reset=reset, number=number)
    name = f"since {predicate.name}" + (
        "" if reset is None else f" without {reset.name}"
    )
    parts = (predicate,) if reset is None else (predicate, reset)
    return Since(
        name,
        lambda state: memory in state.remembered,
        parts,
        memory=memory,
        looks=False,
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Kept:
    """A number as it was at the last step at which something held; made by `kept`."""

    bits: tuple[Since, ...]
    """Memories of the binary digits of its whole units, lowest first."""
    unit: float

    def value(self, state: StateView) -> float:
        """The number, rounded down to whole units; 0 where nothing has held so far."""
        return self.unit * sum(
            2**place for place, bit in enumerate(self.bits) if bit.ask(state)
        )


def digit_at(place: int, units: Any) -> Any:
    """Whether the binary digit at a place of a whole number is 1."""
    return units // 2**place % 2 >= 1


def kept(
    name: str,
    number: Callable[[StateView], float],
    *,
    when: Predicate,
    unit: float,
    most: float,
) -> Kept:
    """A number as it was at the last step at which `when` held, kept in memories of `since`.

    What asks for its value has its bits among its parts.

    Args:
        name: What it is, for messages.
        number: The number, at least 0; it takes many simulations at once.
        when: When it is looked at.
        unit: What it is rounded to.
        most: What it is below.
    """

    def units(state: StateView) -> float:
        return state.once(units, lambda _sim: number(state) / unit // 1)

    whole = Number(units=units, when=when)

    def bit(place: int) -> Since:
        digit = leaf(
            f"digit {place} of {name}", lambda state: digit_at(place, units(state))
        )
        return since(when & digit, reset=when & ~digit, number=whole)

    return Kept(bits=tuple(map(bit, range(int(most / unit).bit_length()))), unit=unit)


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
    repr=False,
)
class HeldFor(Predicate):
    """A predicate that has held for some time."""

    clock: StepClock
    seconds: float
    """Least duration in seconds."""

    @property
    def steps(self) -> int:
        """The same in control steps."""
        return _steps(self.seconds)

    def _first_cost(self) -> int:
        return 0

    def _unmet(self, state: StateView) -> Words:
        part = self.clock.of
        lasted = state.lasted.get(self.clock, 0) / CONTROL_HZ
        return part.unmet(state) or (
            f"only for {lasted:.2f} s, not for {self.seconds:g} s: {part.name}",
        )


def _steps(seconds: float) -> int:
    return max(round(seconds * CONTROL_HZ), 1)


@shared
def held_for(
    predicate: Predicate, seconds: float, *, reset: Predicate | None = None
) -> Predicate:
    """`predicate` has held for some time: without a break, or in all.

    Args:
        predicate: What must hold.
        seconds: For how long, rounded to control steps of 1/30 s, one at least.
        reset: Where it is given, time is summed up over breaks since it held last. Otherwise
            `predicate` has held at every control step of the last `seconds`.
    """
    if not 0 < seconds < math.inf:
        raise TaskError(f"A time that something holds is above 0 s, got {seconds!r}.")
    clock = StepClock(of=predicate, reset=reset)
    steps = _steps(seconds)
    return HeldFor(
        f"{predicate.name} for {seconds:g} s" + ("" if reset is None else " in all"),
        lambda state: state.lasted.get(clock, 0) >= steps,
        (predicate,) if reset is None else (predicate, reset),
        clock=clock,
        seconds=seconds,
    )


@shared
def _not(predicate: Predicate) -> Predicate:
    ask = predicate.ask
    return Not(
        f"not {predicate.name}", lambda state: not ask(state), (predicate,), looks=False
    )


def _cheapest_first(
    predicates: Sequence[Predicate],
) -> tuple[Callable[[StateView], bool], ...]:
    """Functions that ask predicates of which one may settle it: poses are looked at last."""
    return tuple(part.ask for part in sorted(predicates, key=lambda part: part.cost))


@shared
def all_of(*predicates: Predicate) -> Predicate:
    """All hold; parts are asked in any order."""
    name = " and ".join(p.name for p in predicates)
    asks = _cheapest_first(predicates)

    def test(state: StateView) -> bool:
        for ask in asks:  # noqa: SIM110 - a third of the time of a generator
            if not ask(state):
                return False
        return True

    return AllOf(
        f"({name})",
        test,
        predicates,
        looks=False,
    )


@shared
def any_of(*predicates: Predicate) -> Predicate:
    """Disjunction: at least one predicate holds; parts are asked in any order."""
    name = " or ".join(p.name for p in predicates)
    asks = _cheapest_first(predicates)

    def test(state: StateView) -> bool:
        for ask in asks:  # noqa: SIM110 - a third of the time of a generator
            if ask(state):
                return True
        return False

    return AnyOf(
        f"({name})",
        test,
        predicates,
        looks=False,
    )


def _each_once(words: Iterable[Words]) -> Words:
    return tuple(dict.fromkeys(text for some in words for text in some))
