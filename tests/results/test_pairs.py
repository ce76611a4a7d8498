"""What is tested, against what, and what is not."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from duobench.core.randomness import SUITE_VERSION
from duobench.results.comparison import compare
from duobench.results.entrants import RowKind
from duobench.results.pairs import Pair, RunComparison
from duobench.results.statistics import (
    LEVEL,
    episodes_that_would_tell,
    holm,
    mcnemar,
    newcombe_interval,
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


def test_other_episodes_are_two_samples(good: str, tmp_path: Path) -> None:
    pair = pair_of(good, play(tmp_path / "bad", BAD, "bad", first_episode=11))
    assert not pair.paired
    sort = next(test for test in pair.tests if test.row.label == "Sort")
    assert (sort.only, sort.p, sort.adjusted) == (None, None, None)
    assert (sort.better, sort.more_episodes) == (0, None)
    assert sort.interval == newcombe_interval((9, 2), (11, 11))
    gained = sum(GOOD["sort"]) - sum(BAD["sort"])
    assert sort.progress == pytest.approx(gained / 11 / 3)
    assert len(pair.of(RowKind.OVERALL)) == 1


def test_samples_with_other_shares_of_tasks_are_not_pooled(good: str, tmp_path: Path) -> None:
    fewer = {**BAD, "sort": [1, 2]}
    pair = pair_of(good, play(tmp_path / "bad", fewer, "bad", first_episode=11))
    assert (len(pair.of(RowKind.TASK)), pair.of(RowKind.OVERALL)) == (3, ())


def test_episodes_would_tell_at_the_level_of_the_whole_family(pair: Pair) -> None:
    tasks = {test.row.label: test for test in pair.of(RowKind.TASK)}
    lift = tasks["Lift <It>"]
    assert lift.more_episodes == episodes_that_would_tell(*lift.only, 11, level=LEVEL / 3)
    assert tasks["Turn"].more_episodes is None  # no difference was seen
    (overall,) = pair.of(RowKind.OVERALL)
    assert (overall.better, overall.more_episodes, pair.whole) == (1, None, overall)


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
        (
            {"config": replace(CONFIG, cameras=("head",), depth=("head",))},
            True,
            ("seen beyond the robot's images nothing and depth (head)",),
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
