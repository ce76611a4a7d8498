"""Memory that forgets, against a plain reading of the same sequence of events."""

import itertools

import pytest

from duobench.tasks.stages.logic import held_for, since
from tests.tasks.stages.bench import Bench

STEPS = 5


def remembered(past: tuple[str, ...], event: str, until: str) -> bool:
    """The event was, and neither at that step nor at a later one what makes it forgotten."""
    return any(
        event in step and not any(until in later for later in past[number:])
        for number, step in enumerate(past)
    )


@pytest.mark.parametrize("first", ["", "p", "q", "pq"])
def test_ever_until_is_of_earlier_steps_and_forgets(bench: Bench, first: str) -> None:
    question = since(bench.fact("p"), reset=bench.fact("q"))
    for rest in itertools.product(["", "p", "q", "pq"], repeat=STEPS - 1):
        steps = (first, *rest)
        expected = [remembered(steps[:now], "p", "q") for now in range(STEPS)]
        assert bench.answers(question, steps) == expected, steps


def test_each_until_the_other_tells_who_was_last(bench: Bench) -> None:
    left, right = bench.fact("l"), bench.fact("r")
    lasts = {"l": since(left, reset=right), "r": since(right, reset=left)}
    for letters in itertools.product("lr-", repeat=STEPS):
        for letter, last in lasts.items():
            expected = [
                "".join(letters[:now]).replace("-", "")[-1:] == letter for now in range(STEPS)
            ]
            assert bench.answers(last, letters) == expected, letters


@pytest.mark.parametrize(
    ("steps", "expected"),
    [("prx", 1), ("prqx", 0), ("prqprx", 1), ("prpqx", 0), ("pqrx", 0), ("rpx", 0), ("qprx", 1)],
)
def test_what_is_forgotten_is_forgotten_inside_other_memories_too(
    bench: Bench, steps: str, expected: int
) -> None:
    """r after p, and no q since p, nor since r."""
    p, q, r, x = map(bench.fact, "pqrx")
    question = x & since(r & since(p, reset=q), reset=q)
    assert bench.answers(question, steps)[-1] == bool(expected)


def test_a_memory_with_and_one_without_an_end_are_two(bench: Bench) -> None:
    p, q = bench.fact("p"), bench.fact("q")
    assert bench.answers(since(p) & ~since(p, reset=q), ("p", "", "q", "")) == [0, 0, 0, 1]


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        (("a", "", "a", "", "a", ""), [0, 0, 0, 0, 1, 1]),
        (("a", "a", "r", "a", "a", "a"), [0, 0, 0, 0, 0, 1]),
        (("ar", "a", "a", "a"), [0, 0, 0, 1]),  # not that step
    ],
)
def test_time_is_summed_up_over_breaks_until_it_is_reset(
    bench: Bench, steps: tuple[str, ...], expected: list[int]
) -> None:
    assert bench.answers(held_for(bench.fact("a"), 0.1, reset=bench.fact("r")), steps) == expected
