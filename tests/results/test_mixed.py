"""The table of trainings by worlds: all tasks together, policies side by side, paired tests."""

import csv
import json
from pathlib import Path

import pytest
from markupsafe import escape

from duobench.core.errors import EvaluationError
from duobench.results.mixed import MixedTable, Place, markdown, read_mixed, write_mixed
from duobench.results.scores import wilson_interval
from duobench.results.suite import TaskInfo
from tests.results.samples import LIFT, SORT, sample_folder, sample_record, sample_run

EPISODES = 12
FAR = {LIFT: (1, 2), SORT: (1, 2, 3)}
"""When the last stage of each task is reached."""
SOLVED = {"sim": 1, "real": 4, "mixed": EPISODES}
"""Episodes of each task that a training of ACT solves."""


def folder(path: Path, task: TaskInfo, solved: int, episodes: int = EPISODES, **run: str) -> str:
    """A run on one task whose first episodes are solved."""
    one = sample_run(tasks=(task,), episodes=episodes, **run)
    records = [
        sample_record(task, episode, FAR[task] if episode < solved else ())
        for episode in range(episodes)
    ]
    return str(sample_folder(path, one, records).path)


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> MixedTable:
    """ACT with three trainings, each evaluated task by task, and another policy with one."""
    path = tmp_path_factory.mktemp("runs")
    sources = [
        f"ACT/{training}={folder(path / f'{training}-{task.id}', task, solved)}"
        for training, solved in SOLVED.items()
        for task in (LIFT, SORT)
    ]
    for task in (LIFT, SORT):
        sources.append(f"X-VLA/mixed={folder(path / f'x-{task.id}', task, 6)}")
    return read_mixed(sources)


def test_policies_stand_side_by_side_with_a_row_for_all_tasks(table: MixedTable) -> None:
    assert [row.label for row in table.rows] == [LIFT.title, SORT.title, "All tasks"]
    assert table.policies == ["ACT", "X-VLA"]
    lines = {(row.label, trained_on): found for row, trained_on, found in table.lines()}
    assert len(lines) == 9
    act, _, other, _ = lines["All tasks", "mixed"]
    assert act is not None
    assert (act.successes, act.episodes) == (2 * EPISODES, 2 * EPISODES)
    assert other is not None
    assert other.interval == wilson_interval(12, 2 * EPISODES)
    act, real, other, _ = lines[LIFT.title, "sim"]
    assert act is not None
    assert (act.successes, real, other) == (1, None, None)


def test_trainings_are_tested_in_pairs(table: MixedTable) -> None:
    pairs = {(test.pair.a.title, test.pair.b.title): test for test in table.tests}
    assert list(pairs) == [
        ("ACT trained on sim", "ACT trained on real"),
        ("ACT trained on sim", "ACT trained on mixed"),
        ("ACT trained on real", "ACT trained on mixed"),
    ]
    clear = pairs["ACT trained on sim", "ACT trained on mixed"]
    assert clear.pair.paired
    overall = clear.pair.tests[-1]
    assert overall.only == (0, 2 * (EPISODES - 1))
    assert overall.better == -1
    assert "ACT trained on mixed is better than ACT trained on sim in 2 of 2 tasks" in clear.text
    assert "with the same episodes" in clear.text
    assert "Over all tasks: 2 of 24 episodes against 24 of 24" in clear.text
    unclear = pairs["ACT trained on sim", "ACT trained on real"]
    assert "cannot be told apart" in unclear.text


def test_files_hold_the_same(table: MixedTable, tmp_path: Path) -> None:
    page = write_mixed(table, tmp_path / "mixed").read_text()
    text = (tmp_path / "mixed" / "mixed.md").read_text()
    assert text == markdown(table)
    for test in table.tests:
        assert test.text in text
        assert str(escape(test.text)) in page
    with (tmp_path / "mixed" / "mixed.csv").open() as file:
        rows = list(csv.DictReader(file))
    document = json.loads((tmp_path / "mixed" / "mixed.json").read_text())
    assert document["all"] == [LIFT.id, SORT.id]
    assert len(rows) == len(document["rows"]) == 12
    for row, entry in zip(rows, document["rows"], strict=True):
        assert int(row["successes"]) == entry["successes"]
        assert row["task"] == entry["task"]
    assert [each["b"] for each in document["tests"]] == [
        "ACT trained on real",
        "ACT trained on mixed",
        "ACT trained on mixed",
    ]
    assert all(each["paired"] for each in document["tests"])
    latex = (tmp_path / "mixed" / "mixed.tex").read_text()
    assert latex.count(r"\\") == 10
    assert "X-VLA on real arms" in latex


def test_other_episodes_are_tested_as_two_samples(tmp_path: Path) -> None:
    ours = folder(tmp_path / "a", LIFT, 3)
    theirs = sample_run(tasks=(LIFT,), first_episode=100, episodes=5)
    records = [sample_record(LIFT, 100 + number, (1,)) for number in range(5)]
    other = sample_folder(tmp_path / "b", theirs, records).path
    (test,) = read_mixed([f"sim={ours}", f"mixed={other}"]).tests
    assert not test.pair.paired
    assert "with different episodes: trained on sim and trained on mixed" in test.text


def test_task_that_one_training_lacks_is_in_no_sum(tmp_path: Path) -> None:
    sources = [
        f"sim={folder(tmp_path / 'a', LIFT, 3)}",
        f"sim={folder(tmp_path / 'b', SORT, 3)}",
        f"mixed={folder(tmp_path / 'c', LIFT, 3)}",
    ]
    table = read_mixed(sources)
    assert [row.label for row in table.rows] == [LIFT.title, SORT.title]
    assert table.score(table.rows[1], Place("", "mixed", "sim")) is None
    with pytest.raises(EvaluationError, match="second run of lift"):
        read_mixed([*sources, f"sim={folder(tmp_path / 'd', LIFT, 3)}"])


def test_two_suites_are_not_added_up(tmp_path: Path) -> None:
    ours = folder(tmp_path / "a", LIFT, 3)
    one = sample_run(tasks=(SORT,), episodes=1, version="0")
    record = sample_record(SORT, 0, (), suite_version="0")
    other = sample_folder(tmp_path / "b", one, [record]).path
    with pytest.raises(EvaluationError, match="different suites"):
        read_mixed([f"sim={ours}", f"sim={other}"])
