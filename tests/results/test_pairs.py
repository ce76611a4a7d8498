"""What is tested, against what, and what is not."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from duobench.core.randomness import SUITE_VERSION
from duobench.results.compare import compare
from duobench.results.entrants import RowKind
from duobench.results.pairs import Pair, RunComparison
from duobench.results.statistics import (
    any_time,
    barnard,
    holm,
    mcnemar,
    newcombe_interval,
    paired_permutation,
    permutation,
    tango_interval,
)
from tests.results.outcomes import play
from tests.results.samples import CONFIG

GOOD = {"sort": [3] * 9 + [1, 0], "lift": [2, 2, 1, 0, 2, 1, 2, 0, 2, 2, 2], "turn": [1] * 11}
BAD = {"sort": [1] * 8 + [3, 1, 3], "lift": [2, 1, 0, 0, 1, 2, 2, 0, 2, 1, 2], "turn": [1] * 11}


def pair_of(*sources: str) -> Pair:
    (pair,) = compare(sources).pairs
    return pair


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> str:
    return play(tmp_path_factory.mktemp("good"), GOOD, "good")


@pytest.fixture(scope="module")
def pair(good: str, tmp_path_factory: pytest.TempPathFactory) -> Pair:
    """Both on the same episodes."""
    return pair_of(good, play(tmp_path_factory.mktemp("bad"), BAD, "bad"))


def test_same_episodes_are_tested_in_pairs(pair: Pair) -> None:
    assert (pair.paired, pair.left_out) == (True, 0)
    sort = next(test for test in pair.tests if test.row.label == "Sort")
    assert (sort.only, sort.successes, sort.episodes) == ((8, 1), (9, 2), (11, 11))
    assert (sort.p, sort.interval) == (mcnemar(8, 1), tango_interval(8, 1, 11))
    stages = [a - b for a, b in zip(GOOD["sort"], BAD["sort"], strict=True)]
    assert sort.progress_p == paired_permutation(stages)
    assert sort.progress == pytest.approx(sum(stages) / 11 / 3)


def test_tasks_are_one_family_and_all_tasks_another(pair: Pair) -> None:
    tasks = pair.of(RowKind.TASK)
    assert [test.adjusted for test in tasks] == holm([test.p for test in tasks])
    (overall,) = pair.of(RowKind.OVERALL)
    assert overall.only == (11, 2)
    assert overall.adjusted == overall.p == mcnemar(11, 2)
    (both,) = pair.of(RowKind.CATEGORY)
    assert (both.row.label, both.only) == ("bimanual manipulation", (3, 1))


def test_progress_of_tasks_with_other_numbers_of_stages_adds_up(pair: Pair) -> None:
    (overall,) = pair.of(RowKind.OVERALL)
    highest = {"sort": 3, "lift": 2, "turn": 1}
    gains = [
        (a - b) / highest[task] for task in GOOD for a, b in zip(GOOD[task], BAD[task], strict=True)
    ]
    assert overall.progress == pytest.approx(sum(gains) / 33)
    assert overall.progress_p == paired_permutation([round(6 * gain) for gain in gains])


def test_other_episodes_are_two_samples(good: str, tmp_path: Path) -> None:
    pair = pair_of(good, play(tmp_path / "bad", BAD, "bad", first_episode=11))
    assert not pair.paired
    sort = next(test for test in pair.tests if test.row.label == "Sort")
    assert (sort.only, sort.more_episodes) == (None, None)
    assert sort.p == barnard((9, 2), (11, 11))
    assert sort.interval == newcombe_interval((9, 2), (11, 11))
    assert sort.progress_p == permutation(GOOD["sort"], BAD["sort"])
    assert len(pair.of(RowKind.OVERALL)) == 1


def test_samples_with_other_shares_of_tasks_are_not_pooled(good: str, tmp_path: Path) -> None:
    fewer = {**BAD, "sort": [1, 2]}
    pair = pair_of(good, play(tmp_path / "bad", fewer, "bad", first_episode=11))
    assert (len(pair.of(RowKind.TASK)), pair.of(RowKind.OVERALL)) == (3, ())


# --- at every look -------------------------------------------------------------------------------

WON, LOST = [1] * 12, [0] * 12


def any_times(pair: Pair) -> dict[str, tuple[float, int]]:
    return {test.row.label: (test.any_time, test.any_time_episodes) for test in pair.tests}


def test_any_time_counts_episode_by_episode_and_all_tasks_of_each(pair: Pair) -> None:
    won = {
        task: [
            (int(a == high > b), int(b == high > a))
            for a, b in zip(GOOD[task], BAD[task], strict=True)
        ]
        for task, high in (("sort", 3), ("lift", 2), ("turn", 1))
    }
    tasks = pair.of(RowKind.TASK)
    expected = [any_time(won[test.row.tasks[0].id]) for test in tasks]
    assert [test.any_time for test in tasks] == expected
    assert [test.any_time_adjusted for test in tasks] == holm(expected)
    (overall,) = pair.of(RowKind.OVERALL)
    steps = [
        (sum(a for a, _ in each), sum(b for _, b in each))
        for each in zip(*won.values(), strict=True)
    ]
    assert overall.any_time_adjusted == overall.any_time == any_time(steps) < 1
    assert overall.any_time_episodes == 33


def test_any_time_of_other_episodes_is_none(good: str, tmp_path: Path) -> None:
    pair = pair_of(good, play(tmp_path / "bad", BAD, "bad", first_episode=11))
    assert {(test.any_time, test.is_any_time) for test in pair.tests} == {(1.0, False)}


def test_any_time_ends_at_an_episode_that_is_still_to_come(tmp_path: Path) -> None:
    """In between, it would change what was seen at an earlier look."""
    won, lost = (
        play(tmp_path / name, {"turn": stages}, name)
        for name, stages in (("won", WON), ("lost", LOST))
    )
    assert any_times(pair_of(won, lost)) == {"Turn": (any_time([(1, 0)] * 12), 12)}
    (record,) = Path(lost).rglob("*00004*.json")
    text = record.read_bytes()
    record.unlink()
    assert any_times(pair_of(won, lost)) == {"Turn": (any_time([(1, 0)] * 4), 4)}
    record.write_bytes(text)
    (record.with_name(record.name.replace("00004", "00000"))).unlink()
    assert any_times(pair_of(won, lost)) == {"Turn": (1.0, 0)}


def test_any_time_begins_where_the_later_run_does(tmp_path: Path) -> None:
    won = play(tmp_path / "won", {"turn": WON}, "won")
    lost = play(tmp_path / "lost", {"turn": LOST}, "lost", first_episode=5)
    assert any_times(pair_of(won, lost)) == {"Turn": (any_time([(1, 0)] * 7), 7)}


def test_any_time_of_a_run_under_way_is_that_of_all_its_tasks(tmp_path: Path) -> None:
    """Tasks are played one after another: each look would have another family, another sum."""
    of_a = {"turn": WON, "sort": [3] * 12, "lift": []}
    of_b = {"turn": LOST, "sort": LOST, "lift": []}
    pair = pair_of(play(tmp_path / "a", of_a, "a"), play(tmp_path / "b", of_b, "b"))
    each = any_time([(1, 0)] * 12), 12
    assert any_times(pair) == {"Sort": each, "Turn": each, "All tasks": (1.0, 0)}
    assert [test.any_time_adjusted for test in pair.of(RowKind.TASK)] == [3 * each[0], 3 * each[0]]
    of_a["lift"], of_b["lift"] = [2, 2, 2], [0, 0]
    pair = pair_of(play(tmp_path / "c", of_a, "c"), play(tmp_path / "d", of_b, "d"))
    assert any_times(pair)["All tasks"] == (any_time([(3, 0)] * 2), 6)


def layout(y: float, **variants: str) -> dict[str, object]:
    return {"poses": {"cube": [0.5, y, -0.0, 0.0, 0.0, 0.0, 1.0]}, "variants": variants}


@pytest.mark.parametrize(
    ("changes", "paired", "conditions"),
    [
        ({"layout": layout(0.2)}, False, ()),
        ({"layout": {"poses": {}, "variants": {"cup": "left"}}}, False, ()),
        ({"layout": layout(0.1, cup="left")}, False, ()),
        ({"layout": layout(0.1 + 1e-12)}, True, ()),  # the last bit does not matter
        (
            {"config": replace(CONFIG, look="dark"), "look": "dark"},
            True,
            ("look default and dark",),
        ),
    ],
)
def test_episodes_are_the_same_where_their_layouts_are(
    good: str, tmp_path: Path, changes: dict[str, Any], paired: bool, conditions: tuple[str, ...]
) -> None:
    pair = pair_of(good, play(tmp_path / "bad", BAD, "bad", **changes))
    assert (pair.paired, pair.conditions) == (paired, conditions)


def test_only_shared_episodes_are_tested(good: str, tmp_path: Path) -> None:
    half = {task: stages[:6] for task, stages in BAD.items()}
    pair = pair_of(good, play(tmp_path / "bad", half, "bad", first_episode=5))
    assert (pair.paired, pair.left_out) == (True, 15)
    assert {test.episodes for test in pair.of(RowKind.TASK)} == {(6, 6)}


def test_tasks_of_one_run_are_shown_and_not_tested(good: str, tmp_path: Path) -> None:
    comparison = compare([good, play(tmp_path / "one", {"sort": BAD["sort"]}, "one")])
    assert [row.label for row in comparison.rows] == ["Sort", "Lift <It>", "Turn"]
    (pair,) = comparison.pairs
    assert [test.row.label for test in pair.tests] == ["Sort"]


def test_scores_of_other_suites_are_shown_and_not_tested(good: str, tmp_path: Path) -> None:
    pair = pair_of(good, play(tmp_path / "old", BAD, "old", suite_version="3"))
    assert pair.tests == ()
    assert f"different suites ({SUITE_VERSION} and 3)" in (pair.obstacle or "")


# --- who is the best -----------------------------------------------------------------------------


def best(comparison: RunComparison) -> dict[str, list[str]]:
    return {
        row.label: [one.name for one in comparison.entrants if comparison.is_best(row, one)]
        for row in comparison.rows
    }


def test_best_is_who_is_better_than_every_other_of_its_group(tmp_path: Path) -> None:
    outcomes = {"every": [1] * 12, "none": [0] * 12, "nearly": [1] * 11 + [0], "told": [1] * 12}
    every, none, nearly, told = (
        play(tmp_path / name, {"turn": stages}, name, object_state=name == "told")
        for name, stages in outcomes.items()
    )
    assert best(compare([every, none])) == {"Turn": ["every"]}
    assert best(compare([every, none, nearly])) == {"Turn": []}
    assert best(compare([none, told])) == {"Turn": []}
    assert best(compare([every, none, told, "paper:ACT"])) == {"Turn": ["every"]}


def test_published_policies_are_never_tested(good: str, tmp_path: Path) -> None:
    comparison = compare([good, "paper:ACT", play(tmp_path / "bad", BAD, "bad"), "authors:pi05"])
    assert [(pair.a.name, pair.b.name) for pair in comparison.pairs] == [("good", "bad")]
