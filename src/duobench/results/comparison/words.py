"""What the tests of two runs say, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from duobench.results.comparison.entrants import Group
from duobench.results.comparison.pairs import Pair, Test
from duobench.results.comparison.rows import Kind
from duobench.results.comparison.text import (
    about,
    listed,
    p_phrase,
    points_interval_text,
    points_text,
)


def verdict(pair: Pair) -> str:
    """The shortest answer to which of two runs is better."""
    a, b = pair.a.name, pair.b.name
    if pair.obstacle:
        return f"{a} and {b} are not compared. {pair.obstacle}"
    tests = pair.of(Kind.TASK)
    if len(tests) == 1:
        return _single(pair, tests[0])
    won = [test.row.label for test in tests if test.better > 0]
    lost = [test.row.label for test in tests if test.better < 0]
    tied = len(tests) - len(won) - len(lost)
    if not (won or lost):
        return f"{a} and {b} cannot be told apart in any of {len(tests)} tasks after Holm."
    if won:
        text = f"{a} {_beats(pair)} {b} in {len(won)} of {len(tests)} tasks after Holm"
        also = f"; the other way round in {len(lost)} ({listed(lost)})" if lost else ""
    else:
        text = f"{b} {_beats(pair)} {a} in {len(lost)} of {len(tests)} tasks after Holm"
        also = ""
    names = listed(won or lost)
    others = "the other one" if tied == 1 else f"the other {tied}"
    rest = f". In {others} they cannot be told apart" if tied else ""
    return f"{text} ({names}){also}{rest}."


def overall(pair: Pair) -> str:
    """What the test over all tasks says; empty without one."""
    tests = pair.of(Kind.OVERALL)
    if not tests:
        return ""
    (test,) = tests
    who = _winner(pair, test.better)
    start = f"{test.row.label} together: "
    start += f"{who} {_beats(pair, alone=True)}, " if who else "they cannot be told apart, "
    return f"{start}{_numbers(test)}{_more(test)}"


def progress(pair: Pair) -> str:
    """What the tests of final progress say, where they say anything; empty if not."""
    tests = pair.of(Kind.TASK)
    parts = []
    for sign, name in ((1, pair.a.name), (-1, pair.b.name)):
        further = [test.row.label for test in tests if test.further == sign]
        if further:
            count = (
                "" if len(tests) == 1 else f" in {len(further)} of {len(tests)} tasks after Holm"
            )
            tasks = "" if len(tests) == 1 else f" ({listed(further)})"
            parts.append(f"{name} gets further{count}{tasks}")
    return f"By mean final progress, {'; '.join(parts)}." if parts else ""


def undecided(pair: Pair) -> list[tuple[str, str]]:
    """Each task in which two runs cannot be told apart, and what would tell."""
    tests = [test for test in pair.of(Kind.TASK) if not test.better]
    return [(test.row.label, f"{_counts(test)}.{_more(test)}") for test in tests]


def basis(pair: Pair) -> str:
    """On which episodes the tests are."""
    if pair.obstacle:
        return ""
    counts = [test.episodes for test in pair.of(Kind.TASK)]
    if not pair.paired:
        return (
            "Unpaired: the two did not play the same episodes, so that luck with the layouts is "
            "part of the difference. On the same episodes fewer would tell as much."
        )
    number = _range([ours for ours, _ in counts])
    text = f"Paired: both played the same {number} episodes{' a task' if len(counts) > 1 else ''}."
    if pair.left_out:
        text += f" {pair.left_out:,} episodes that only one of them has finished are left out."
    return text


def caution(pair: Pair) -> list[str]:
    """What a reader must know before believing the comparison."""
    notes = conditions(pair)
    if pair.crosses_groups:
        knows = pair.a if pair.a.group is Group.PRIVILEGED else pair.b
        sees = pair.b if knows is pair.a else pair.a
        notes.insert(
            0,
            f"Across groups: {knows.name} knows from the simulation where the objects are, "
            f"{sees.name} has to see it. A difference says how far apart the two are, the worth of "
            "that knowledge included; it does not say which policy is the better one.",
        )
    return notes


def conditions(pair: Pair) -> list[str]:
    """What else than the policies differs, as a sentence, if anything does."""
    if not pair.conditions:
        return []
    return [
        f"Not the policies alone differ, but also: {'; '.join(pair.conditions)}. A difference may "
        "come from either."
    ]


def _single(pair: Pair, test: Test) -> str:
    """The verdict on one task."""
    a, b = pair.a.name, pair.b.name
    if who := _winner(pair, test.better):
        other = b if who == a else a
        return f"{who} {_beats(pair)} {other} in {test.row.label}: {_numbers(test)}"
    return f"{a} and {b} cannot be told apart in {test.row.label}: {_numbers(test)}{_more(test)}"


def _winner(pair: Pair, better: int) -> str:
    return (pair.a.name if better > 0 else pair.b.name) if better else ""


def _beats(pair: Pair, *, alone: bool = False) -> str:
    """What the tests say of the winner; of another group, better is not the word."""
    verb = "solves more" if pair.crosses_groups else "is better"
    return verb if alone else f"{verb} than"


def _counts(test: Test) -> str:
    """Successes of both."""
    (ours, theirs), (n, m) = test.successes, test.episodes
    return (
        f"{ours} against {theirs} of {n:,}"
        if n == m
        else f"{ours} of {n:,} against {theirs} of {m:,}"
    )


def _numbers(test: Test) -> str:
    """Successes of both and their difference, the better one first."""
    test = test.turned() if test.better < 0 else test
    return (
        f"{_counts(test)} episodes, a difference of {points_text(test.difference)} points "
        f"(95 % interval {points_interval_text(test.interval)}, {p_phrase(test.p)})."
    )


def _more(test: Test) -> str:
    """How many more episodes would tell, as a sentence that may follow another one."""
    if test.better or test.only is None:
        return ""
    if test.only[0] == test.only[1]:
        return " No difference was seen, so no number of episodes follows."
    if test.more_episodes is None:
        return " More than a million episodes would be needed."
    plural = "s" if test.more_episodes > 1 else ""
    return f" About {about(test.more_episodes)} more episode{plural} would tell."


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return f"{low:,}" if low == high else f"{low:,} to {high:,}"
