"""Nearness of predicates to holding, from 0 to 1: the basis of a dense reward.

It reads the same descriptions as the stages do, and decides nothing: no stage, record or score
depends on it. Conjunctions are as near as their parts on average, alternatives as the nearest of
them, and what says how far off it is (`Predicate.off`) is nearer the less that is. Of one episode
it is a number, of n at once an array (n,) of the same numbers.
"""

import operator
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from duobench.tasks.stages.logic import (
    AllOf,
    AnyOf,
    HeldFor,
    Not,
    Predicate,
    Since,
    StateView,
    StepClock,
)
from duobench.tasks.stages.predicates import AtLeast, VariantIs

ALMOST = 0.9
"""The most that what does not hold counts, so that to hold is always worth something."""


class Nearness:
    """Measures predicates at one control step.

    Args:
        view: The step as predicates see it, of one episode or of many.
        holds: Whether a predicate holds.
        lasted: How many control steps a clock has counted.
    """

    def __init__(
        self,
        view: StateView,
        holds: Callable[[Predicate], Any],
        lasted: Callable[[StepClock], Any],
    ) -> None:
        self._view = view
        self._holds = holds
        self._lasted = lasted
        self._known: dict[Predicate, Any] = {}

    def of(self, predicate: Predicate) -> Any:
        """1 where it holds, and up to `ALMOST` where it does not."""
        near = self._known.get(predicate)
        if near is None:
            holds = self._holds(predicate)
            near = (
                1.0
                if holds is True
                else holds + (1.0 - holds) * ALMOST * self._not_yet(predicate)
            )
            self._known[predicate] = near
        return near

    def _not_yet(self, predicate: Predicate) -> Any:
        parts = predicate.parts
        match predicate:
            case AllOf():
                # Choices of the layout cannot change: they only say which alternative counts.
                able = [1.0 * self._holds(part) for part in parts if _is_choice(part)]
                others = [self.of(part) for part in parts if not _is_choice(part)]
                near = reduce(operator.mul, able, sum(others) / max(len(others), 1))
            case AnyOf():
                near = reduce(np.maximum, [self.of(part) for part in parts], 0.0)
            case AtLeast():
                nearest = np.sort(
                    np.array([self.of(part) + 0.0 for part in parts]), axis=0
                )[::-1]
                near = sum(nearest[: predicate.count]) / predicate.count
            case Since():
                near = ALMOST * self.of(predicate.memory.event)
            case HeldFor():
                so_far = np.minimum(
                    self._lasted(predicate.clock) / predicate.steps, 1.0
                )
                near = (self.of(predicate.clock.of) + so_far) / 2
            case _ if predicate.off is not None:
                near = 1.0 / (1.0 + np.maximum(predicate.off(self._view), 0.0))
            case _:
                near = 0.0
        return near


def _is_choice(predicate: Predicate) -> bool:
    """Whether it is the layout's choice alone."""
    if isinstance(predicate, Not | AllOf | AnyOf):
        return all(map(_is_choice, predicate.parts))
    return isinstance(predicate, VariantIs)
