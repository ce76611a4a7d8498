"""Progress from constraints: the rule of the paper, with one owner of the memory.

stage_{t+1} = max({stage_t} and every k whose constraints all hold in s_t): stages never fall. A
constraint may remember in two ways only: `since(p, reset=q)`, whether p held at an earlier control
step and q has not held since, and `held_for(p, seconds)`, whether p has held for some time.
"""

from __future__ import annotations

from collections.abc import (
    Collection,
    Iterable,
    Mapping,
    Sequence,
)
from dataclasses import dataclass
from typing import TYPE_CHECKING

from duobench.core.errors import Named, TaskError, UnknownNameError
from duobench.core.types import CONTROL_HZ
from duobench.tasks.stages.logic import (
    HeldFor,
    Memory,
    Number,
    Predicate,
    Since,
    StateView,
    StepClock,
    Words,
    digit_at,
)
from duobench.tasks.stages.nearness import Nearness
from duobench.tasks.stages.predicates import VariantIs

if TYPE_CHECKING:
    from duobench.world.sim.contacts import Pair
    from duobench.world.sim.simulation import Simulation


@dataclass(frozen=True, kw_only=True, slots=True)
class Stage:
    """One milestone of a task."""

    name: str
    """Name in a few words: "both cubes held"."""
    instruction: str
    """Instruction that leads to it, in the imperative."""
    holds: Predicate
    stays: Predicate | None = None
    """Condition of it that later stages take for granted. Where it is lost, this stage's
    instruction is what is to be done now, though the stage was reached. None if nothing can be
    lost."""

    def __post_init__(self) -> None:
        given: list[object] = [
            self.holds,
            *([] if self.stays is None else [self.stays]),
        ]
        for value in given:
            if not isinstance(value, Predicate):
                raise TaskError(
                    f"Stage {self.name!r} takes predicates, got a {type(value).__name__}; a "
                    'function of a state becomes one as Predicate("what holds", function).'
                )


LOST_SECONDS = 0.5
"""How long what stays of a stage is gone before it counts as lost, in seconds: hands that change
and contacts that flicker take less."""
LOST_STEPS = round(LOST_SECONDS * CONTROL_HZ)
"""The same in control steps."""
JUDGEMENTS = 2
"""How many different judgements are kept for steps that come to the same: a contact flickers."""


def sinces_in(predicates: Iterable[Predicate]) -> list[Since]:
    """All that these predicates remember with `since`, inner ones first."""
    return [part for p in predicates for part in p.walk() if isinstance(part, Since)]


def memories_in(predicates: Iterable[Predicate]) -> tuple[Memory, ...]:
    """The memories of these predicates, each once, inner ones first."""
    return tuple(dict.fromkeys(part.memory for part in sinces_in(predicates)))


def clocks_in(predicates: Iterable[Predicate]) -> tuple[StepClock, ...]:
    """The clocks of these predicates, each once, inner ones first."""
    inner = (part for predicate in predicates for part in predicate.walk())
    return tuple(
        dict.fromkeys(part.clock for part in inner if isinstance(part, HeldFor))
    )


def _awaited(predicates: Iterable[Predicate]) -> dict[StepClock, int]:
    """The control steps after which each clock of these predicates has nothing more to say."""
    steps: dict[StepClock, int] = {}
    for part in (part for predicate in predicates for part in predicate.walk()):
        if isinstance(part, HeldFor):
            steps[part.clock] = max(part.steps, steps.get(part.clock, 0))
    return steps


def recalled(memories: Sequence[Memory], state: StateView) -> frozenset[Memory]:
    """Memories after a step. All of it sees the same step, so the order is free."""
    before = state.remembered
    new: list[Memory] = []
    gone: list[Memory] = []
    for memory in memories:
        event = memory.event
        reset = memory.reset
        if memory in before:
            if reset is not None and reset.ask(state):
                gone.append(memory)
        elif event.ask(state) and not (reset is not None and reset.ask(state)):
            new.append(memory)
    return before.union(new).difference(gone) if new or gone else before


@dataclass(frozen=True, kw_only=True, slots=True)
class ProgressState:
    """The stage of an episode, and all that its constraints remember."""

    stage: int
    final_holds: bool = False
    """Whether the last stage's constraints hold."""
    remembered: tuple[bool, ...] = ()
    """Whether each `since` holds, in the order of the stages."""
    lasted: tuple[int, ...] = ()
    """Control steps that each `held_for` has counted, in the same order."""
    start_heights: tuple[tuple[str, float], ...] = ()
    """Height of each prop's lowest point when the episode began, in metres."""
    lost: tuple[int, ...] = ()
    """Control steps in a row in which nothing of each stage has stayed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Judgement:
    """A step that reached nothing new, and changed nothing of what is remembered.

    A later one comes to the same where all that was looked at is as it was, as long as stage and
    memories are the same: predicates are pure.
    """

    pairs: tuple[tuple[Pair, bool], ...]
    """Owners of contacts that were all that some predicates looked at, and whether they touched."""
    told: Mapping[Predicate, bool]
    """Values of these predicates."""
    waits: tuple[tuple[StepClock, int, bool], ...]
    """Clocks that were looked at, counts that were waited for, and whether they were reached."""
    seen: tuple[tuple[Predicate, bool], ...]
    """Other predicates that looked at the step, in the order in which they were asked, and their
    values."""
    running: tuple[StepClock, ...]
    """Clocks that it counted for."""
    cleared: Mapping[StepClock, int]
    """Clocks that it set back, and 0 for each; all others have stayed as they were."""
    final_holds: bool
    stayed: tuple[bool, ...]
    """Whether the lasting part of each reached stage has stayed."""
    followed: tuple[Number, ...]
    """Numbers that were looked at, and may have changed."""
    read: frozenset[Number]
    """Numbers on whose digits some answer depended."""


def check_names(
    stages: Sequence[Stage],
    simulation: Simulation,
    variants: Mapping[str, str],
    options: Mapping[str, Collection[str]],
) -> None:
    """Ask every predicate once, so that a misspelt name is an error before the first episode.

    Args:
        stages: The stages.
        simulation: As compiled, before anything touches anything.
        variants: The named choices of any layout.
        options: The values that each variant may have; those that follow from others are not here.

    Raises:
        UnknownNameError: A predicate names what is not there; near misses are listed.
        TaskError: A predicate asks another one that remembers, and is not among its parts.
    """
    names = simulation.props
    heights = Named("object", {name: simulation.min_height(name) for name in names})
    state = StateView(
        simulation=simulation,
        start_heights=heights,
        variants=variants,
        remembered=frozenset(),
    )
    parts: dict[Predicate, Stage] = {}
    for stage in stages:
        inner = (
            part for predicate in constraints_of([stage]) for part in predicate.walk()
        )
        parts |= {part: stage for part in inner if part not in parts}
    for part, stage in parts.items():
        try:
            part.test(state)
            if isinstance(part, VariantIs):
                _check_variant(part, variants, options)
        except UnknownNameError as error:
            raise UnknownNameError(f"Stage {stage.name!r}: {error}") from error
        asked = state.answers.keys() | state.conclusions.keys()
        unnamed = asked - parts.keys()
        lost = [p for p in unnamed if memories_in([p]) or clocks_in([p])]
        if lost:
            raise TaskError(
                f"{part.name!r} asks {', '.join(sorted(repr(p.name) for p in lost))}, and does "
                "not name it in its parts, the third argument of Predicate: its memory is not kept."
            )


def _check_variant(
    part: VariantIs, variants: Mapping[str, str], options: Mapping[str, Collection[str]]
) -> None:
    if part.choice not in variants:
        raise UnknownNameError("variant", part.choice, variants)
    values = options.get(part.choice)
    if values is not None and part.value not in values:
        raise UnknownNameError(f"value of variant {part.choice!r}", part.value, values)


def constraints_of(stages: Iterable[Stage]) -> list[Predicate]:
    """Predicates that must hold at some stage, and those that must stay."""
    both = (predicate for stage in stages for predicate in (stage.holds, stage.stays))
    return [predicate for predicate in both if predicate is not None]


class Progress:
    """The stage of one running episode. Evaluated once a control step, after physics."""

    def __init__(self, stages: tuple[Stage, ...]) -> None:
        """Collect what must be remembered.

        Args:
            stages: Stages 1 to n in order.
        """
        self._stages = stages
        constraints = constraints_of(stages)
        self._memories = memories_in(constraints)
        self._events = [m for m in self._memories if m.number is None]
        """Memories that are no digits of a number."""
        self._digits: dict[Number, list[Since]] = {}
        """Binary digits of each number that is remembered, lowest first."""
        for part in dict.fromkeys(sinces_in(constraints)):
            if part.memory.number is not None:
                self._digits.setdefault(part.memory.number, []).append(part)
        self._units: dict[Number, float] = {}
        """Each of these numbers that was looked at since the last reset."""
        self._remembered: frozenset[Memory] = frozenset()
        self._clocks = clocks_in(constraints)
        self._awaited = _awaited(constraints)
        self._lasted: dict[StepClock, int] = {}
        self._start_heights: dict[str, float] = {}
        self._variants: Mapping[str, str] = {}
        self.stage = 0
        """The highest stage so far."""
        self.final_holds = False
        """Whether the last stage's constraints hold right now."""
        self._lost = [0] * len(stages)
        self._explained: list[Since] | None = None
        self._past: dict[Memory, str] = {}
        self._judged: StateView | None = None
        self._state: StateView | None = None
        """The step that was judged last, of this episode."""
        self._recent: list[_Judgement] = []
        """Different ones with this stage and these memories, the last one first."""
        self._pairs: dict[Predicate, Pair] = {}
        """Owners of contacts that predicates look at, in the simulation of this episode."""

    def explain(self, on: bool = True) -> None:
        """Be able to say in `unmet` why the next stage is not reached.

        What was missing when something was let go is told of steps from here on.
        """
        constraints = [stage.holds for stage in self._stages]
        self._explained = sinces_in(constraints) if on else None
        self._past = {}
        self._judged = None
        self._state = None
        self._recent.clear()

    @property
    def unmet(self) -> Words:
        """Reason why the next stage is not reached, in words, if `explain` asks for it.

        It looks at the simulation, which must still be as it was judged.
        """
        if self._judged is None or self.success:
            return ()
        return self._stages[self.stage].holds.unmet(self._judged)

    @property
    def max_stage(self) -> int:
        """Number of the last stage."""
        return len(self._stages)

    @property
    def success(self) -> bool:
        """Whether the last stage was reached."""
        return self.stage == self.max_stage

    @property
    def standing(self) -> int:
        """The stage from which to go on: the last one before the lowest that was lost since."""
        return next(
            (n for n, lost in enumerate(self._lost) if lost >= LOST_STEPS), self.stage
        )

    def nearness(self, simulation: Simulation) -> float:
        """Nearness of the next stage, from 0 to below 1, see `stages.nearness`.

        It follows from the state of the simulation and from what is remembered; 0 after the last.
        """
        if self.success:
            return 0.0
        state = self._view(simulation)
        measure = Nearness(
            state, lambda predicate: predicate.ask(state), self._lasted.__getitem__
        )
        return float(measure.of(self._stages[self.stage].holds))

    def reset(self, simulation: Simulation, variants: Mapping[str, str]) -> None:
        """Begin an episode at the simulation's current state.

        Args:
            simulation: Settled in the episode's layout.
            variants: The layout's named choices.
        """
        self._variants = dict(variants)
        self._pairs.clear()
        self._remembered = frozenset()
        self._lasted = dict.fromkeys(self._clocks, 0)
        self._start_heights = {
            name: simulation.min_height(name) for name in simulation.props
        }
        self.stage = 0
        self.final_holds = False
        self._lost = [0] * self.max_stage
        self._past = {}
        self._judged = None
        self._state = None
        self._recent.clear()
        self._units.clear()

    def get_state(self) -> ProgressState:
        """All that the next judgement depends on, beside the simulation and the layout."""
        return ProgressState(
            stage=self.stage,
            final_holds=self.final_holds,
            remembered=tuple(memory in self._remembered for memory in self._memories),
            lasted=tuple(self._lasted[clock] for clock in self._clocks),
            start_heights=tuple(self._start_heights.items()),
            lost=tuple(self._lost),
        )

    def set_state(self, state: ProgressState, variants: Mapping[str, str]) -> None:
        """Continue from a state of the same stages.

        Args:
            state: What `get_state` gave.
            variants: The layout's named choices.

        Raises:
            ValueError: The state is that of other stages.
        """
        memories = zip(self._memories, state.remembered, strict=True)
        self._remembered = frozenset(memory for memory, holds in memories if holds)
        self._lasted = dict(zip(self._clocks, state.lasted, strict=True))
        self._start_heights = dict(state.start_heights)
        self._lost = list(state.lost)
        self._variants = dict(variants)
        self.stage, self.final_holds = state.stage, state.final_holds
        self._past = {}
        self._judged = None
        self._state = None
        self._recent.clear()
        self._units.clear()

    def counts_since(self, earlier: ProgressState) -> bool:
        """Whether a clock has counted since an earlier state of which something is still awaited.

        Then time alone may change what is reached, or what is to be done.
        """
        clocks = zip(self._clocks, earlier.lasted, strict=True)
        return any(
            before < self._lasted[clock] < self._awaited[clock]
            for clock, before in clocks
        ) or any(
            before < lost < LOST_STEPS
            for before, lost in zip(earlier.lost, self._lost, strict=True)
        )

    def update(self, simulation: Simulation) -> int:
        """Judge the current state of the simulation and return the stage."""
        state = self._state
        if state is None:
            state = self._state = self._view(simulation)
        else:
            state.begin(simulation, self._remembered, self._lasted)
        for number, judgement in enumerate(self._recent):
            if self._is_repeated(judgement, state):
                if number > 0:
                    self._recent.insert(0, self._recent.pop(number))
                stayed = judgement.stayed
                if judgement.followed:
                    self._follow(judgement.followed, state)
                break
        else:
            stayed = self._judge(state)
        if not all(stayed) or any(self._lost):
            self._lost[: self.stage] = [
                0 if stays else lost + 1
                for stays, lost in zip(stayed, self._lost, strict=False)
            ]
        return self.stage

    def _is_repeated(self, earlier: _Judgement, state: StateView) -> bool:
        """Whether this step comes to the same as an earlier one; if so, clocks have counted it.

        Supposed that it does, clocks count so: what they say is among what is looked at then. Up to
        the first answer that differs all is as it is without that, since a clock is asked after it
        has counted.

        Args:
            earlier: The earlier step.
            state: This one; it gets the answers about it so far.
        """
        if not state.simulation.contacts.are_touching(earlier.pairs):
            return False
        lasted = self._lasted.copy()
        lasted.update(earlier.cleared)
        for clock in earlier.running:
            lasted[clock] += 1
        for clock, count, is_over in earlier.waits:
            if (lasted[clock] >= count) is not is_over:
                return False
        state.lasted = lasted
        answers = state.answers
        for predicate, answer in earlier.seen:
            now = answers.get(predicate)
            if now is None:
                now = answers[predicate] = predicate.test(state)
            if now != answer:
                answers.update(earlier.told)
                return False
        self._lasted = lasted
        self.final_holds = earlier.final_holds
        return True

    def _judge(self, state: StateView) -> tuple[bool, ...]:
        """Ask all that matters at a step; return what stays of each stage that is reached."""
        before = self.stage, self._remembered
        state.lasted = self._lasted
        running: list[StepClock] = []
        cleared: dict[StepClock, int] = {}
        for clock in self._clocks:
            counts = clock.counts(state)
            if counts:
                self._lasted[clock] += 1
                running.append(clock)
            elif counts is None:
                self._lasted[clock] = cleared[clock] = 0
        self.final_holds = self._stages[-1].holds(state)
        # Stages never fall, so only higher ones are asked, and the highest that holds counts.
        for number in range(self.max_stage, self.stage, -1):
            if self._stages[number - 1].holds(state):
                self.stage = number
                break
        stays = (stage.stays for stage in self._stages[: self.stage])
        stayed = tuple(part is None or part.ask(state) for part in stays)
        self._remembered = recalled(self._events, state)
        followed = [number for number in self._digits if number.when.ask(state)]
        if (self.stage, self._remembered) != before:
            self._recent.clear()
        elif self._explained is None:
            judgement = self._recorded(state, running, cleared, stayed, followed)
            self._recent = [judgement, *self._recent[: JUDGEMENTS - 1]]
        self._follow(followed, state)
        if self._explained is not None:
            self._explain(self._explained, state)
        return stayed

    def _follow(self, numbers: Iterable[Number], state: StateView) -> None:
        """Remember what numbers are at this step."""
        for number in numbers:
            units = number.units(state)
            if units == self._units.get(number):
                continue
            self._units[number] = units
            digits = self._digits[number]
            ones = [
                d.memory for place, d in enumerate(digits) if digit_at(place, units)
            ]
            others = self._remembered.difference(digit.memory for digit in digits)
            self._remembered = others.union(ones)
            self._recent = [each for each in self._recent if number not in each.read]

    def _recorded(
        self,
        state: StateView,
        running: list[StepClock],
        cleared: dict[StepClock, int],
        stayed: tuple[bool, ...],
        followed: list[Number],
    ) -> _Judgement:
        contacts = state.simulation.contacts
        pairs: list[tuple[Pair, bool]] = []
        told: dict[Predicate, bool] = {}
        waits: list[tuple[StepClock, int, bool]] = []
        seen: list[tuple[Predicate, bool]] = []
        for predicate, answer in state.answers.items():
            touch = predicate.touch
            if touch is not None:
                pair = self._pairs.get(predicate)
                if pair is None:
                    pair = self._pairs[predicate] = contacts.pair(touch)
                is_touching = contacts.is_touching(pair)
                if touch.is_all or not is_touching:
                    pairs.append((pair, is_touching))
                    told[predicate] = answer
                    continue
            elif isinstance(predicate, HeldFor):
                waits.append((predicate.clock, predicate.steps, answer))
                continue
            seen.append((predicate, answer))
        return _Judgement(
            pairs=tuple(pairs),
            told=told,
            waits=tuple(waits),
            seen=tuple(seen),
            running=tuple(running),
            cleared=cleared,
            final_holds=self.final_holds,
            stayed=stayed,
            followed=tuple(followed),
            read=frozenset(
                number
                for number, digits in self._digits.items()
                if not state.conclusions.keys().isdisjoint(digits)
            ),
        )

    def _view(self, simulation: Simulation) -> StateView:
        return StateView(
            simulation=simulation,
            start_heights=self._start_heights,
            variants=self._variants,
            remembered=self._remembered,
            lasted=self._lasted,
            past=self._past,
        )

    def _explain(self, sinces: Iterable[Since], state: StateView) -> None:
        for part in sinces:
            why = part.look_back(state, self._remembered)
            if why is None:
                self._past.pop(part.memory, None)
            else:
                self._past[part.memory] = why
        self._judged = state
