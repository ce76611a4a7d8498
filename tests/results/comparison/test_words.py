from pathlib import Path

from duobench.results.compare import compare
from duobench.results.comparison import text, words
from duobench.results.comparison.pairs import Pair
from tests.results.comparison.runs import play

WON = {"sort": [3] * 12, "turn": [1] * 12, "lift": [2] * 6 + [0] * 6}
LOST = {"sort": [0] * 12, "turn": [1] * 11 + [0], "lift": [2] * 6 + [0] * 6}


def pair_of(tmp_path: Path, a: dict[str, list[int]], b: dict[str, list[int]], **more: bool) -> Pair:
    sources = play(tmp_path / "a", a, "new"), play(tmp_path / "b", b, "old", **more)
    (pair,) = compare(sources).pairs
    return pair


def test_winner_is_named_with_its_tasks(tmp_path: Path) -> None:
    pairs = pair_of(tmp_path / "1", WON, LOST), pair_of(tmp_path / "2", LOST, WON)
    for pair, winner, loser in zip(pairs, ("new", "old"), ("old", "new"), strict=True):
        assert words.verdict(pair) == (
            f"{winner} is better than {loser} in 1 of 3 tasks after Holm (Sort). "
            "In the other 2 they cannot be told apart."
        )


def test_numbers_are_seen_from_the_winner(tmp_path: Path) -> None:
    for pair in (pair_of(tmp_path / "1", WON, LOST), pair_of(tmp_path / "2", LOST, WON)):
        assert "is better, 30 against 17 of 36 episodes, a difference of +36.1 points" in (
            words.overall(pair)
        )


def test_undecided_tasks_say_what_would_tell(tmp_path: Path) -> None:
    told = dict(words.undecided(pair_of(tmp_path, WON, LOST)))
    assert told["Lift <It>"] == (
        "6 against 6 of 12. No difference was seen, so no number of episodes follows."
    )
    assert told["Turn"].startswith("12 against 11 of 12. About ")
    assert told["Turn"].endswith(" more episodes would tell.")


def test_one_task_is_told_in_one_sentence(tmp_path: Path) -> None:
    pair = pair_of(tmp_path, {"sort": [3] * 12}, {"sort": [0] * 12})
    assert words.verdict(pair).startswith(
        "new is better than old in Sort: 12 against 0 of 12 episodes, a difference of +100.0 points"
    )
    assert words.overall(pair) == ""
    assert words.progress(pair) == "By mean final progress, new gets further."


def test_across_groups_nobody_is_called_better(tmp_path: Path) -> None:
    pair = pair_of(tmp_path, WON, LOST, object_state=True)
    said = [words.verdict(pair), words.overall(pair)]
    assert all("better" not in sentence for sentence in said)
    assert "new solves more than old in 1 of 3 tasks" in said[0]
    assert "Across groups: old knows from the simulation" in words.caution(pair)[0]


def test_basis_says_whether_episodes_were_the_same(tmp_path: Path) -> None:
    a = play(tmp_path / "a", WON, "new")
    for first, expected in ((0, "Paired: both played the same 12"), (12, "Unpaired:")):
        b = play(tmp_path / f"b{first}", LOST, "old", first_episode=first)
        (pair,) = compare([a, b]).pairs
        assert words.basis(pair).startswith(expected)


def test_numbers_as_text() -> None:
    assert [text.about(number) for number in (7, 61, 1137, 18_001)] == [
        "7",
        "61",
        "1,200",
        "19,000",
    ]
    assert [text.p_text(p) for p in (0.0004, 0.0123, 1.0)] == ["< 0.001", "0.012", "1.000"]
    assert [text.signed(x, 1) for x in (0.04, -0.04, 1.25, -3.0)] == [
        "0.0",
        "0.0",
        "+1.2",
        f"{text.MINUS}3.0",
    ]
    assert text.listed(["a"]) == "a"
    assert text.listed(["a", "b", "c"]) == "a, b and c"
