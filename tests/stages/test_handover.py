"""The handover as logic, against a plain reading of the same sequence of events."""

import itertools

import pytest

from duobench.stages.handover import MAX_ATTEMPTS, MAX_TURNS, _in_one_go, last_of
from duobench.stages.predicates import Predicate
from tests.recall import Recall


class Sequence:
    """A question to one letter of a sequence after another."""

    def __init__(self) -> None:
        self.now = ""

    def letter(self, letter: str) -> Predicate:
        return Predicate(letter, lambda _moment: self.now == letter)

    def ask(self, letters: str, question: Predicate) -> list[bool]:
        recall, answers = Recall(question), []
        for self.now in letters:
            answers.append(recall.ask())
        return answers


def test_the_last_of_two_is_the_one_before_now() -> None:
    sequence = Sequence()
    lasts = last_of(sequence.letter("l"), sequence.letter("r"))
    for letters in map("".join, itertools.product("lr-", repeat=5)):
        for letter, last in zip("lr", lasts, strict=True):
            expected = [letters[:n].replace("-", "")[-1:] == letter for n in range(5)]
            assert sequence.ask(letters, last) == expected, letters


def test_after_too_many_changes_neither_is_the_last() -> None:
    sequence = Sequence()
    left, right = last_of(sequence.letter("l"), sequence.letter("r"))
    letters = "lr" * (MAX_TURNS + 1)
    expected = [0 < terms <= MAX_TURNS + 1 for terms in range(len(letters))]
    assert sequence.ask(letters, left | right) == expected


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
