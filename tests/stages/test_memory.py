"""Memory that forgets, against a plain reading of the same sequence of events."""

import itertools

import pytest

from duobench.stages.logic import Predicate, held_for, since
from tests.predicate_probe import PredicateProbe

STEPS = 5


class Sequence:
    """Questions about one step of a sequence after another; a step is the letters that hold."""

    def __init__(self) -> None:
        self.now = ""

    def letter(self, letter: str) -> Predicate:
        return Predicate(letter, lambda _moment: letter in self.now)

    def ask(self, steps: tuple[str, ...], question: Predicate) -> list[bool]:
        probe, answers = PredicateProbe(question), []
        for self.now in steps:
            answers.append(probe.ask())
        return answers


def remembered(past: tuple[str, ...], event: str, until: str) -> bool:
    """The event was, and neither at that step nor at a later one what makes it forgotten."""
    return any(
        event in step and not any(until in later for later in past[number:])
        for number, step in enumerate(past)
    )


@pytest.mark.parametrize("first", ["", "p", "q", "pq"])
def test_ever_until_is_of_earlier_steps_and_forgets(first: str) -> None:
    sequence = Sequence()
    question = since(sequence.letter("p"), reset=sequence.letter("q"))
    for rest in itertools.product(["", "p", "q", "pq"], repeat=STEPS - 1):
        steps = (first, *rest)
        expected = [remembered(steps[:now], "p", "q") for now in range(STEPS)]
        assert sequence.ask(steps, question) == expected, steps


def test_each_until_the_other_tells_who_was_last() -> None:
    sequence = Sequence()
    left, right = sequence.letter("l"), sequence.letter("r")
    lasts = {"l": since(left, reset=right), "r": since(right, reset=left)}
    for letters in itertools.product("lr-", repeat=STEPS):
        for letter, last in lasts.items():
            expected = [
                "".join(letters[:now]).replace("-", "")[-1:] == letter for now in range(STEPS)
            ]
            assert sequence.ask(letters, last) == expected, letters


@pytest.mark.parametrize(
    ("steps", "expected"),
    [("prx", 1), ("prqx", 0), ("prqprx", 1), ("prpqx", 0), ("pqrx", 0), ("rpx", 0), ("qprx", 1)],
)
def test_what_is_forgotten_is_forgotten_inside_other_memories_too(
    steps: str, expected: int
) -> None:
    """r after p, and no q since p, nor since r."""
    sequence = Sequence()
    p, q, r, x = map(sequence.letter, "pqrx")
    question = x & since(r & since(p, reset=q), reset=q)
    assert sequence.ask(tuple(steps), question)[-1] == bool(expected)


def test_a_memory_with_and_one_without_an_end_are_two() -> None:
    sequence = Sequence()
    p, q = sequence.letter("p"), sequence.letter("q")
    question = since(p) & ~since(p, reset=q)
    assert sequence.ask(("p", "", "q", ""), question) == [False, False, False, True]


def test_time_is_summed_up_over_breaks_until_it_is_reset() -> None:
    sequence = Sequence()
    a, r = sequence.letter("a"), sequence.letter("r")
    question = held_for(a, 0.1, reset=r)
    assert sequence.ask(("a", "", "a", "", "a", ""), question) == [False] * 4 + [True] * 2
    assert sequence.ask(("a", "a", "r", "a", "a", "a"), question) == [False] * 5 + [True]
    assert sequence.ask(("ar", "a", "a", "a"), question) == [False] * 3 + [True], "not that step"
