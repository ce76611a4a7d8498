"""The stages of many episodes at once: the same descriptions and rule, answered with arrays.

`stages.progress` judges one episode, and stops at the first constraint that does not hold. Here all
constraints are evaluated for n episodes. Both know the same at every step.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from duobench.tasks.stages.logic import (
    AllOf,
    AnyOf,
    HeldFor,
    Memory,
    Not,
    Predicate,
    Since,
    StateView,
)
from duobench.tasks.stages.nearness import Nearness
from duobench.tasks.stages.predicates import AtLeast
from duobench.tasks.stages.progress import (
    LOST_STEPS,
    ProgressState,
    Stage,
    clocks_in,
    constraints_of,
    memories_in,
)

if TYPE_CHECKING:
    from duobench.world.sim.batch import SimulationBatch

Booleans = NDArray[np.bool_]
Counts = NDArray[np.int64]


class ProgressBatch:
    """The stages of n running episodes. Evaluated once a control step, after physics.

    Args:
        stages: The stages in order.
        simulations: The episodes' simulations.
    """

    def __init__(self, stages: tuple[Stage, ...], simulations: SimulationBatch) -> None:
        self._stages, self._simulations = stages, simulations
        constraints, count = constraints_of(stages), simulations.count
        self._memories, self._clocks = memories_in(constraints), clocks_in(constraints)
        self._same, self._partial = _sorted(part for each in constraints for part in each.walk())
        self.stage: Counts = np.zeros(count, dtype=np.int64)
        """The highest stage so far of each episode (n,)."""
        self.final_holds: Booleans = np.zeros(count, dtype=np.bool_)
        """Whether the last stage's constraints hold right now (n,)."""
        self._remembered = {memory: np.zeros(count, dtype=np.bool_) for memory in self._memories}
        self._lasted = {clock: np.zeros(count, dtype=np.int64) for clock in self._clocks}
        self._lost: Counts = np.zeros((len(stages), count), dtype=np.int64)
        self._heights = {name: np.zeros(count) for name in simulations.props}
        self._all = np.ones(count, dtype=np.bool_)
        self._view = self._look(simulations, self._heights, simulations.variants)
        self._answers: dict[Predicate, Booleans] = {}
        self._known: dict[Predicate, Booleans] = {}

    @property
    def standing(self) -> Counts:
        """The stage from which each episode has to go on (n,); see `Progress.standing`."""
        lost = self._lost >= LOST_STEPS
        return np.where(lost.any(axis=0), lost.argmax(axis=0), self.stage)

    def get_state(self, episode: int) -> ProgressState:
        """What `Progress.get_state` gives for one of the episodes."""
        return ProgressState(
            stage=int(self.stage[episode]),
            final_holds=bool(self.final_holds[episode]),
            remembered=tuple(bool(self._remembered[m][episode]) for m in self._memories),
            lasted=tuple(int(self._lasted[clock][episode]) for clock in self._clocks),
            start_heights=tuple((name, float(h[episode])) for name, h in self._heights.items()),
            lost=tuple(self._lost[:, episode].tolist()),
        )

    def set_state(self, episode: int, state: ProgressState) -> None:
        """Begin or continue one of the episodes from a state of the same stages."""
        for memory, holds in zip(self._memories, state.remembered, strict=True):
            self._remembered[memory][episode] = holds
        for clock, lasted in zip(self._clocks, state.lasted, strict=True):
            self._lasted[clock][episode] = lasted
        for name, height in state.start_heights:
            self._heights[name][episode] = height
        self._lost[:, episode] = state.lost
        self.stage[episode], self.final_holds[episode] = state.stage, state.final_holds

    def update(self, where: Booleans) -> None:
        """Judge the current state of some episodes (n,); the others stay as they are."""
        self._answers, self._known = {}, {}
        self._view = self._look(self._simulations, self._heights, self._simulations.variants)
        for clock, before in self._lasted.items():
            holds = self._ask(clock.of, where)
            if clock.reset is None:
                after = (before + 1) * holds
            else:
                after = (before + holds) * ~self._ask(clock.reset, where)
            self._lasted[clock] = np.where(where, after, before)
        final = self._ask(self._stages[-1].holds, where)
        self.final_holds = np.where(where, final, self.final_holds)
        for number, stage in enumerate(self._stages, 1):
            higher = where & (self.stage < number)
            self.stage[higher & self._ask(stage.holds, higher)] = number
        for number, (stage, lost) in enumerate(zip(self._stages, self._lost, strict=True)):
            reached = where & (self.stage > number)
            gone = 0 if stage.stays is None else ~self._ask(stage.stays, reached)
            self._lost[number] = np.where(reached, (lost + 1) * gone, lost)
        self._remembered = {memory: self._recalled(memory, where) for memory in self._memories}

    def nearness(self) -> NDArray[np.float64]:
        """What `Progress.nearness` gives, for all episodes (n,)."""
        self._answers, self._known = {}, {}
        self._view = self._look(self._simulations, self._heights, self._simulations.variants)
        measure = Nearness(
            self._view, lambda predicate: self._ask(predicate, self._all), self._lasted.__getitem__
        )
        near = [measure.of(stage.holds) + np.zeros(len(self.stage)) for stage in self._stages]
        return np.choose(self.stage, [*near, np.zeros(len(self.stage))])

    def _recalled(self, memory: Memory, where: Booleans) -> Booleans:
        before = self._remembered[memory]
        after = before | self._ask(memory.event, where & ~before)
        if memory.reset is not None:
            after &= ~self._ask(memory.reset, where)
        return np.where(where, after, before)

    def _look(self, simulation: Any, heights: Any, variants: Any, episode: int = -1) -> StateView:
        """A step as predicates see it: of all episodes, or of one, with what it remembers."""
        remembered = (m for m, holds in self._remembered.items() if episode >= 0 and holds[episode])
        return StateView(
            simulation=simulation,
            start_heights=heights,
            variants=variants,
            remembered=frozenset(remembered),
            lasted={clock: int(lasted[episode]) for clock, lasted in self._lasted.items()},
        )

    def _ask(self, predicate: Predicate, where: Booleans) -> Booleans:
        """Where a predicate holds; what it says of other episodes than `where` means nothing."""
        predicate = self._same[predicate]
        if predicate in self._partial:
            return self._answer(predicate, where)
        answer = self._answers.get(predicate)
        if answer is None:
            answer = self._answers[predicate] = self._answer(predicate, self._all)
        return answer

    def _answer(self, predicate: Predicate, where: Booleans) -> Booleans:
        narrow = predicate in self._partial  # so that what takes one at a time is asked seldom
        match predicate:
            case Not():
                holds = ~self._ask(predicate.parts[0], where)
            case AllOf():
                holds = self._all
                for part in predicate.parts:
                    holds = holds & self._ask(part, where & holds if narrow else where)
            case AnyOf():
                holds = ~self._all
                for part in predicate.parts:
                    holds = holds | self._ask(part, where & ~holds if narrow else where)
            case AtLeast():
                parts = [self._ask(part, where) for part in predicate.parts]
                holds = np.sum(parts, axis=0) >= predicate.count
            case Since():
                holds = self._remembered[predicate.memory]
            case HeldFor():
                holds = self._lasted[predicate.clock] >= predicate.steps
            case _:
                holds = self._one_by_one(predicate, where) if narrow else self._test(predicate)
        return holds

    def _test(self, predicate: Predicate) -> Booleans:
        # What is asked of things that are fixed is one answer for all episodes.
        return self._all & np.asarray(predicate.test(self._view))

    def _one_by_one(self, predicate: Predicate, where: Booleans) -> Booleans:
        """Ask what takes one simulation at a time, of those that were not asked at this step."""
        empty = np.zeros((2, len(where)), dtype=np.bool_)
        known, answer = self._known.setdefault(predicate, empty)
        for number in np.flatnonzero(where & ~known).tolist():
            heights = {name: float(height[number]) for name, height in self._heights.items()}
            world = self._simulations.world(number)
            answer[number] = predicate.test(self._look(world, heights, world.variants, number))
        known |= where
        return answer


def _sorted(
    predicates: Iterable[Predicate],
) -> tuple[dict[Predicate, Predicate], set[Predicate]]:
    """Sort predicates, inner ones first.

    Returns:
        For each the first of those that ask the same in other words; and those of them with a part
        that takes one simulation at a time.
    """
    same: dict[Predicate, Predicate] = {}
    firsts: dict[tuple[object, ...], Predicate] = {}
    partial: set[Predicate] = set()
    for predicate in predicates:
        key, takes_one = (predicate.test,), False
        if isinstance(predicate, Not | AllOf | AnyOf):
            key = type(predicate), *(same[part] for part in predicate.parts)
        if isinstance(predicate, Not | AllOf | AnyOf | AtLeast):
            takes_one = any(same[part] in partial for part in predicate.parts)
        elif not isinstance(predicate, Since | HeldFor):
            # What combines or remembers answers its test for one simulation alone.
            plain = (type(p) is Predicate and same[p] not in partial for p in predicate.parts)
            takes_one = not (predicate.vectorized and all(plain))
        same[predicate] = firsts.setdefault(key, predicate)
        if takes_one:
            partial.add(same[predicate])
    return same, partial
