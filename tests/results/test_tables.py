import re
from pathlib import Path

from duobench.results import tables
from duobench.results.compare import compare
from duobench.results.pairs import Pair
from tests.results.outcomes import play

WON = {"sort": [3] * 12, "turn": [1] * 12, "lift": [2] * 6 + [0] * 6}
LOST = {"sort": [0] * 12, "turn": [1] * 11 + [0], "lift": [2] * 6 + [0] * 6}


def pair_of(tmp_path: Path, a: dict[str, list[int]], b: dict[str, list[int]], **more: bool) -> Pair:
    sources = play(tmp_path / "a", a, "new"), play(tmp_path / "b", b, "old", **more)
    (pair,) = compare(sources).pairs
    return pair


def test_winner_is_named_with_its_tasks(tmp_path: Path) -> None:
    pairs = pair_of(tmp_path / "1", WON, LOST), pair_of(tmp_path / "2", LOST, WON)
    for pair, winner, loser in zip(pairs, ("new", "old"), ("old", "new"), strict=True):
        assert tables.verdict(pair) == (
            f"{winner} is better than {loser} in 1 of 3 tasks after Holm (Sort)."
        )


def test_what_cannot_be_told_says_how_much_more_would_tell(tmp_path: Path) -> None:
    equal = tables.verdict(pair_of(tmp_path / "1", WON, WON))
    assert equal == "new and old cannot be told apart in any of 3 tasks after Holm."
    turn = {"turn": [1] * 12}, {"turn": [1] * 11 + [0]}
    verdict = tables.verdict(pair_of(tmp_path / "2", *turn))
    assert verdict.startswith("new and old cannot be told apart in Turn: 12 of 12 episodes against")
    assert re.search(r"\(95 % .*, p = 1\.000\); about \d+ more episodes would tell\.$", verdict)


def test_one_task_is_told_with_its_numbers(tmp_path: Path) -> None:
    pair = pair_of(tmp_path, {"sort": [3] * 12}, {"sort": [0] * 12})
    assert tables.verdict(pair).startswith(
        "new is better than old in Sort: 12 of 12 episodes against 0 of 12, +100.0 points (95 % "
    )


def test_across_groups_nobody_is_called_better(tmp_path: Path) -> None:
    pair = pair_of(tmp_path, WON, LOST, object_state=True)
    assert tables.verdict(pair) == "new solves more than old in 1 of 3 tasks after Holm (Sort)."


def test_numbers_as_text() -> None:
    assert [tables.about(number) for number in (7, 61, 1137, 18_001)] == [
        "7",
        "61",
        "1,200",
        "19,000",
    ]
    assert [tables.p_text(p) for p in (0.0004, 0.0123, 1.0)] == ["< 0.001", "0.012", "1.000"]
    assert [tables.signed(x, 1) for x in (0.04, -0.04, 1.25, -3.0)] == [
        "0.0",
        "0.0",
        "+1.2",
        f"{tables.MINUS}3.0",
    ]
    assert tables.listed(["a"]) == "a"
    assert tables.listed(["a", "b", "c"]) == "a, b and c"
