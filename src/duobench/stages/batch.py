"""The stages of many episodes at once: the same descriptions and rule, answered with arrays.

`stages.progress` judges one episode, and stops at the first constraint that does not hold. Here all
constraints are evaluated for n episodes, with booleans (n,). Both give the same stages and memories
at every step.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from duobench.stages.logic import (
    AllOf,
    AnyOf,
    HeldFor,
    Memory,
    Not,
    Predicate,
    Since,
    StateView,
)
from duobench.stages.predicates import AtLeast
from duobench.stages.progress import (
    LOST_STEPS,
    ProgressState,
    Stage,
    clocks_in,
    constraints_of,
    memories_in,
)

if TYPE_CHECKING:
    from duobench.sim.batch import SimulationBatch

Booleans = NDArray[np.bool_]
Counts = NDArray[np.int64]


class ProgressBatch:
    """The stages of n running episodes. Evaluated once a control step, after physics.

    Args:
        stages: Stages 1 to n in order.
        simulations: The episodes' simulations.
    """

    def __init__(self, stages: tuple[Stage, ...], simulations: SimulationBatch) -> None:
        self._stages, self._simulations = stages, simulations
        constraints = constraints_of(stages)
        self._memories, self._clocks = memories_in(constraints), clocks_in(constraints)
        inner = dict.fromkeys(part for predicate in constraints for part in predicate.walk())
        self._same = _one_for_each(inner)
        self._partial = _partial(inner)
        count = simulations.count
        self.stage: Counts = np.zeros(count, dtype=np.int64)
        """The highest stage so far of each episode (n,)."""
        self.final_holds: Booleans = np.zeros(count, dtype=np.bool_)
        """Whether the last stage's constraints hold right now (n,)."""
        self._remembered = {memory: np.zeros(count, dtype=np.bool_) for memory in self._memories}
        self._lasted = {clock: np.zeros(count, dtype=np.int64) for clock in self._clocks}
        self._lost: Counts = np.zeros((len(stages), count), dtype=np.int64)
        self._heights = {name: np.zeros(count) for name in simulations.props}
        self._all = np.ones(count, dtype=np.bool_)
        self._view: StateView = self._look()
        self._answers: dict[Predicate, Booleans] = {}
        self._known: dict[Predicate, Booleans] = {}

    @property
    def max_stage(self) -> int:
        """Number of the last stage."""
        return len(self._stages)

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
        """Begin or continue one of the episodes from a state of the same stages.

        Raises:
            ValueError: The state is that of other stages.
        """
        for memory, holds in zip(self._memories, state.remembered, strict=True):
            self._remembered[memory][episode] = holds
        for clock, lasted in zip(self._clocks, state.lasted, strict=True):
            self._lasted[clock][episode] = lasted
        for name, height in state.start_heights:
            self._heights[name][episode] = height
        self._lost[:, episode] = state.lost
        self.stage[episode], self.final_holds[episode] = state.stage, state.final_holds

    def update(self, where: Booleans) -> None:
        """Judge the current state of some of the episodes; the others stay as they are.

        Args:
            where: Which of them (n,).
        """
        self._answers, self._known = {}, {}
        self._view = self._look()
        for clock in self._clocks:
            count, of = self._lasted[clock], self._ask(clock.of, where)
            if clock.reset is None:
                count = np.where(of, count + 1, 0)
            else:
                count = np.where(self._ask(clock.reset, where), 0, count + of)
            self._lasted[clock] = np.where(where, count, self._lasted[clock])
        final = self._ask(self._stages[-1].holds, where)
        self.final_holds = np.where(where, final, self.final_holds)
        for number, stage in enumerate(self._stages, 1):
            higher = where & (self.stage < number)
            self.stage[higher & self._ask(stage.holds, higher)] = number
        for number, stage in enumerate(self._stages):
            reached = where & (self.stage > number)
            gone = 0 if stage.stays is None else ~self._ask(stage.stays, reached)
            self._lost[number] = np.where(
                reached, gone * (self._lost[number] + 1), self._lost[number]
            )
        self._remembered = {memory: self._recalled(memory, where) for memory in self._memories}

    def _recalled(self, memory: Memory, where: Booleans) -> Booleans:
        before = self._remembered[memory]
        after = before | self._ask(memory.event, where & ~before)
        if memory.reset is not None:
            after &= ~self._ask(memory.reset, where)
        return np.where(where, after, before)

    def _look(self) -> StateView:
        simulations: Any = self._simulations
        heights: Any = self._heights
        variants: Any = simulations.variants
        return StateView(
            simulation=simulations,
            start_heights=heights,
            variants=variants,
            remembered=frozenset(),
        )

    def _ask(self, predicate: Predicate, where: Booleans) -> Booleans:
        """Where a predicate holds; what it says of other episodes than `where` means nothing."""
        predicate = self._same[predicate]
        answer = self._answers.get(predicate)
        if answer is None and predicate in self._partial:
            return self._answer(predicate, where)
        if answer is None:
            answer = self._answers[predicate] = self._answer(predicate, self._all)
        return answer

    def _answer(self, predicate: Predicate, where: Booleans) -> Booleans:
        match predicate:
            case Not():
                holds = ~self._ask(predicate.parts[0], where)
            case AllOf():
                holds = self._ask(predicate.parts[0], where)
                for part in predicate.parts[1:]:
                    holds = holds & self._ask(part, where & holds)
            case AnyOf():
                holds = self._ask(predicate.parts[0], where)
                for part in predicate.parts[1:]:
                    holds = holds | self._ask(part, where & ~holds)
            case AtLeast():
                parts = [self._ask(part, where) for part in predicate.parts]
                holds = np.sum(parts, axis=0) >= predicate.count
            case Since():
                holds = self._remembered[predicate.memory]
            case HeldFor():
                holds = self._lasted[predicate.clock] >= predicate.steps
            case Predicate(vectorized=True):
                holds = np.broadcast_to(np.asarray(predicate.test(self._view)), where.shape)
            case _:
                holds = self._one_by_one(predicate, where)
        return holds

    def _one_by_one(self, predicate: Predicate, where: Booleans) -> Booleans:
        """Ask what takes one simulation at a time, of those that were not asked at this step."""
        empty = np.zeros((2, len(where)), dtype=np.bool_)
        known, answer = self._known.setdefault(predicate, empty)
        for number in np.flatnonzero(where & ~known).tolist():
            view = StateView(
                simulation=self._simulations.world(number),
                start_heights={name: float(h[number]) for name, h in self._heights.items()},
                variants={k: str(v[number]) for k, v in self._simulations.variants.items()},
                remembered=frozenset(m for m, holds in self._remembered.items() if holds[number]),
                lasted={clock: int(lasted[number]) for clock, lasted in self._lasted.items()},
            )
            answer[number] = predicate.test(view)
        known |= where
        return answer


def _one_for_each(predicates: Iterable[Predicate]) -> dict[Predicate, Predicate]:
    """For each predicate, inner ones first, the first of those that ask the same in other words."""
    same: dict[Predicate, Predicate] = {}
    firsts: dict[tuple[object, ...], Predicate] = {}
    for predicate in predicates:
        key: tuple[object, ...] = (predicate.test,)
        if isinstance(predicate, Not | AllOf | AnyOf):
            key = type(predicate), *(same[part] for part in predicate.parts)
        same[predicate] = firsts.setdefault(key, predicate)
    return same


def _partial(predicates: Iterable[Predicate]) -> set[Predicate]:
    """Those, of inner ones first, with a part that is asked for one simulation at a time."""
    partial: set[Predicate] = set()
    for predicate in predicates:
        if isinstance(predicate, Since | HeldFor):
            continue
        if isinstance(predicate, Not | AllOf | AnyOf | AtLeast):
            takes_one = any(part in partial for part in predicate.parts)
        else:
            takes_one = not predicate.vectorized
        if takes_one:
            partial.add(predicate)
    return partial
