"""The handover as logic, against a plain reading of the same sequence of events."""

import itertools
from typing import Any, cast

import pytest

from duobench.stages.handover import MAX_ATTEMPTS, MAX_TURNS, _in_one_go, _last
from duobench.stages.predicates import Ever, Moment, Predicate
from duobench.types import Side


class Sequence:
    """A question to one letter of a sequence after another, and what it remembers."""

    def __init__(self) -> None:
        self.now = ""

    def letter(self, letter: str) -> Predicate:
        return Predicate(letter, lambda _moment: self.now == letter)

    def ask(self, letters: str, question: Predicate) -> list[bool]:
        memories = {part.parts[0] for part in question.walk() if isinstance(part, Ever)}
        remembered: frozenset[Predicate] = frozenset()
        answers = []
        for self.now in letters:
            moment = Moment(
                simulation=cast(Any, None), start_lowest={}, variants={}, remembered=remembered
            )
            answers.append(question(moment))
            remembered |= {p for p in memories if p(moment)}
        return answers


def test_the_last_carrier_is_the_one_before_now() -> None:
    sequence = Sequence()
    last = _last({side: sequence.letter(side[0]) for side in Side})
    for letters in map("".join, itertools.product("lr-", repeat=5)):
        for side in Side:
            expected = [letters[:n].replace("-", "")[-1:] == side[0] for n in range(5)]
            assert sequence.ask(letters, last[side]) == expected, letters


def test_after_too_many_changes_nobody_is_the_last_carrier() -> None:
    sequence = Sequence()
    last = _last({side: sequence.letter(side[0]) for side in Side})
    either = last[Side.LEFT] | last[Side.RIGHT]
    letters = "lr" * (MAX_TURNS + 1)
    expected = [0 < carriers <= MAX_TURNS + 1 for carriers in range(len(letters))]
    assert sequence.ask(letters, either) == expected


@pytest.mark.parametrize(
    ("letters", "expected"),
    [("g?", "1"), ("?g", "0"), ("t?g?t?g?", "0101"), ("gt?gt?g?", "001"), ("gg?ttt?g?", "101")],
)
def test_what_was_put_down_must_be_given_anew(letters: str, expected: str) -> None:
    sequence = Sequence()
    question = _in_one_go(sequence.letter("g"), sequence.letter("t"))
    answers = zip(letters, sequence.ask(letters, question), strict=True)
    assert [answer for letter, answer in answers if letter == "?"] == [d == "1" for d in expected]


def test_after_too_many_attempts_none_counts() -> None:
    sequence = Sequence()
    question = _in_one_go(sequence.letter("g"), sequence.letter("t"))
    assert sequence.ask("g?" + "tg?" * (MAX_ATTEMPTS - 1), question)[-1]
    assert not sequence.ask("g?" + "tg?" * MAX_ATTEMPTS, question)[-1]
