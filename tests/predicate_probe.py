"""Predicates asked one moment after another, with the memory that stages have."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, cast

from duobench.sim.simulation import Simulation
from duobench.stages.logic import Memory, Predicate, StateView
from duobench.stages.progress import clocks_in, memories_in, recalled


class PredicateProbe:
    """A predicate and what it remembers of earlier steps."""

    def __init__(self, question: Predicate) -> None:
        self._question = question
        self._memories = memories_in([question])
        self._remembered: frozenset[Memory] = frozenset()
        self._lasted = dict.fromkeys(clocks_in([question]), 0)

    def ask(
        self,
        simulation: Simulation | None = None,
        start_heights: Mapping[str, float] = MappingProxyType({}),
    ) -> bool:
        """Whether it holds now; without a simulation for predicates that look at none."""
        moment = StateView(
            simulation=cast(Any, simulation),
            start_heights=dict(start_heights),
            variants={},
            remembered=self._remembered,
            lasted=self._lasted,
        )
        for clock, count in self._lasted.items():
            self._lasted[clock] = clock.after(moment, count)
        self._remembered = recalled(self._memories, moment)
        return self._question(moment)
