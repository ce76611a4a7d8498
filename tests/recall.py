"""Predicates asked one moment after another, with the memory that stages have."""

from __future__ import annotations

from typing import Any, cast

from duobench.sim.simulation import Simulation
from duobench.stages.predicates import Ever, Moment, Predicate


class Recall:
    """A predicate and what it remembers of earlier steps."""

    def __init__(self, question: Predicate) -> None:
        self._question = question
        self._memories = {part.parts[0] for part in question.walk() if isinstance(part, Ever)}
        self._remembered: frozenset[Predicate] = frozenset()

    def ask(self, simulation: Simulation | None = None) -> bool:
        """Whether it holds now; without a simulation for predicates that look at none."""
        moment = Moment(
            simulation=cast(Any, simulation),
            start_lowest={},
            variants={},
            remembered=self._remembered,
        )
        self._remembered |= {p for p in self._memories if p(moment)}
        return self._question(moment)
