import re
from pathlib import Path

import pytest

from duobench.results import tables
from duobench.results.compare import compare
from tests.results.outcomes import play

WON = {"sort": [3] * 12, "turn": [1] * 12, "lift": [2] * 6 + [0] * 6}
LOST = {"sort": [0] * 12, "turn": [1] * 11 + [0], "lift": [2] * 6 + [0] * 6}
TURN = {"turn": [1] * 12}, {"turn": [1] * 11 + [0]}


@pytest.mark.parametrize(
    ("a", "b", "object_state", "short", "said"),
    [
        (
            WON,
            LOST,
            False,
            "A in 1 of 3",
            r"new is better than old in 1 of 3 tasks after Holm \(Sort\)\.",
        ),
        (
            LOST,
            WON,
            False,
            "B in 1 of 3",
            r"old is better than new in 1 of 3 tasks after Holm \(Sort\)\.",
        ),
        # Across groups, the policy that knows more is not called the worse one.
        (
            WON,
            LOST,
            True,
            "A in 1 of 3",
            r"new solves more than old in 1 of 3 tasks after Holm \(Sort\)\.",
        ),
        (WON, WON, False, "", r"new and old cannot be told apart in any of 3 tasks after Holm\."),
        (
            *TURN,
            False,
            "",
            "new and old cannot be told apart in Turn: 12 of 12 episodes against 11 of 12, .*"
            r"\(95 % .*, p = 1\.000\); about \d+ more episodes would tell, another look\.",
        ),
        (
            {"sort": [3] * 12},
            {"sort": [0] * 12},
            False,
            "A in 1 of 1",
            "new is better than old in Sort: 12 of 12 episodes against 0 of 12, "
            r"\+100\.0 points \(95 % .*",
        ),
    ],
)
def test_verdict_names_the_winner_or_what_would_tell(
    tmp_path: Path,
    a: dict[str, list[int]],
    b: dict[str, list[int]],
    object_state: bool,
    short: str,
    said: str,
) -> None:
    sources = (
        play(tmp_path / "a", a, "new"),
        play(tmp_path / "b", b, "old", object_state=object_state),
    )
    (pair,) = compare(sources).pairs
    assert re.fullmatch(said, tables.verdict(pair))
    assert tables.wins(pair) == short


@pytest.mark.parametrize(
    ("b", "claimed"),
    [
        (LOST, "it claims a difference in Sort."),
        (WON, "it claims no difference."),
        # Enough for McNemar and one look alone.
        ({**WON, "sort": [0] * 8 + [3] * 4}, "it claims no difference."),
    ],
)
def test_what_holds_at_every_look_is_said(
    tmp_path: Path, b: dict[str, list[int]], claimed: str
) -> None:
    sources = play(tmp_path / "a", WON, "new"), play(tmp_path / "b", b, "old")
    (pair,) = compare(sources).pairs
    assert tables.any_time(pair).endswith(claimed)


def test_numbers_as_text() -> None:
    assert [tables.about(n) for n in (7, 61, 1137, 18_001)] == ["7", "61", "1,200", "19,000"]
    assert [tables.p_text(p) for p in (0.0004, 0.0123, 1.0)] == ["< 0.001", "0.012", "1.000"]
    signed = [tables.signed(x, 1) for x in (0.04, -0.04, 1.25, -3.0)]
    assert signed == ["0.0", "0.0", "+1.2", f"{tables.MINUS}3.0"]
    assert tables.listed(["a"]) == "a"
    assert tables.listed(["a", "b", "c"]) == "a, b and c"
