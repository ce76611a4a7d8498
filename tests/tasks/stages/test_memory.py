"""Memory that forgets, against a plain reading of the same sequence of events."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from duobench.tasks.stages.logic import Kept, Predicate, StateView, held_for, kept, since
from duobench.tasks.stages.progress import Progress
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


def number_of(bench: Bench, value: Callable[[StateView], float]) -> Kept:
    """A number that is remembered where "a" holds."""
    return kept("number", value, when=bench.fact("a"), unit=0.5, most=8.0)


def test_a_number_is_what_it_was_when_it_was_last_looked_at(bench: Bench) -> None:
    now = [0.0]
    number = number_of(bench, lambda _state: now[0])
    reads, goes_on = bench.fact("r"), bench.fact("b")

    def test(state: StateView) -> bool:
        return reads.ask(state) and number.value(state) >= 4.0

    high = Predicate("it was high", test, (reads, *number.bits))
    progress, other = bench.begin(high & goes_on), bench.begin(high & goes_on)
    rng, known = np.random.default_rng(0), 0.0
    for _ in range(500):
        now[0] = float(np.clip(now[0] + rng.normal(), 0.0, 7.9))
        bench.true = {letter for letter in "abr" if rng.random() < 0.7}
        other.set_state(progress.get_state(), {})  # and so forgets every earlier step
        progress.update(bench.sim)
        other.update(bench.sim)
        assert progress.get_state() == other.get_state()
        assert progress.final_holds == ({"b", "r"} <= bench.true and known >= 4.0)
        if "a" in bench.true:
            known = now[0] // 0.5 * 0.5


def judged_while(bench: Bench, progress: Progress, now: list[float], step: str) -> int:
    """How often all is judged anew while a number changes at each of ten steps."""
    bench.play(progress, step, step)
    bench.asked.clear()
    for _ in range(10):
        now[0] += 0.5
        bench.play(progress, step)
    return bench.asked.count("judged")


def test_a_number_that_nothing_reads_changes_without_another_judgement(bench: Bench) -> None:
    now = [0.0]
    number, reads = number_of(bench, lambda _state: now[0]), bench.fact("r")

    def judged(state: StateView) -> bool:
        bench.asked.append("judged")
        return reads.ask(state) and number.value(state) >= 100.0

    progress = bench.begin(Predicate("judged", judged, (reads, *number.bits), looks=False))
    assert judged_while(bench, progress, now, "a") == 0
    assert progress.get_state().remembered == (False, True, False, True, False)
    now[0] = 0.0
    assert judged_while(bench, progress, now, "ar") == 9, "at each step after a change"
