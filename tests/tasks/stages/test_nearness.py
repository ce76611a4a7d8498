"""How near predicates are: parts count on average, alternatives as the nearest that can be."""

from typing import Any, cast

import numpy as np
import pytest

from duobench.tasks.stages.logic import Predicate, StateView, all_of, any_of, held_for, leaf, since
from duobench.tasks.stages.nearness import ALMOST, Nearness
from duobench.tasks.stages.predicates import at_least, variant


def off_by(distance: Any) -> Predicate:
    """What does not hold anywhere where it is off by more than 0."""
    return leaf(f"off by {distance}", lambda _: distance <= 0.0, off=lambda _: distance)


NO, YES = leaf("no", lambda _: False), leaf("yes", lambda _: True)
HALF = off_by(1.0)


def near(predicate: Predicate, lasted: int = 0) -> Any:
    """How near it is in an episode whose layout chose red."""
    state = StateView(
        simulation=cast("Any", None),
        start_heights={},
        variants={"colour": "red"},
        remembered=frozenset(),
        lasted={part.clock: lasted for part in predicate.walk() if hasattr(part, "clock")},
    )
    return Nearness(state, lambda one: one.ask(state), state.lasted.__getitem__).of(predicate)


@pytest.mark.parametrize(
    ("predicate", "expected"),
    [
        (YES, 1.0),
        (NO, 0.0),
        (~YES, 0.0),
        (HALF, ALMOST / 2),
        (off_by(0.0), 1.0),
        (all_of(YES, NO), ALMOST / 2),
        (any_of(NO, HALF), ALMOST * ALMOST / 2),
        (any_of(), 0.0),
        (at_least(2, NO, YES, HALF), ALMOST * (1.0 + ALMOST / 2) / 2),
        (since(YES), ALMOST * ALMOST),
        (variant("colour", "red") & HALF, ALMOST * ALMOST / 2),
        (variant("colour", "blue") & HALF, 0.0),
        ((variant("colour", "blue") | variant("colour", "green")) & YES, 0.0),
    ],
)
def test_it_is_as_near_as_its_parts(predicate: Predicate, expected: float) -> None:
    assert near(predicate) == pytest.approx(expected)


def test_time_counts_from_the_first_step() -> None:
    rest = held_for(HALF, 1.0)
    told = [near(rest, lasted) for lasted in (0, 10, 29, 30)]
    assert told == sorted(told)
    assert told[2] < ALMOST < told[3] == 1.0


def test_many_are_measured_as_one_is() -> None:
    distances = np.array([-1.0, 0.0, 0.5, 3.0])
    many = near(off_by(distances))
    assert many.tolist() == [near(off_by(distance)) for distance in distances.tolist()]
    assert np.all(np.diff(many) <= 0.0)
