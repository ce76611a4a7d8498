from dataclasses import replace
from pathlib import Path

import pytest

from duobench.results.journal import (
    Begun,
    Ended,
    Entry,
    EpisodeTimes,
    Journal,
    Started,
    duration,
    read_attempts,
    read_entries,
    run_times,
    side_by_side,
)
from duobench.results.scores import summarize
from tests.results.samples import LIFT, SORT, TASKS, sample_record

TIMES = EpisodeTimes(total=10.0, simulation=4.0, rendering=1.0, policy=1.5, waiting=0.5, video=0.5)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "1-of-1.jsonl"


def test_times_add_up_by_task_with_their_rest(path: Path) -> None:
    records = [sample_record(SORT, 0), sample_record(SORT, 1), sample_record(LIFT, 0, (5,))]
    journal = Journal(path)
    journal.start("", workers=2)
    for record, times in zip(records, (TIMES, TIMES, None), strict=True):
        journal.begin(record.key)
        journal.end(record, times)
    times = run_times(summarize(TASKS, records), read_entries(path))
    (row,) = times.rows
    assert (row.label, row.episodes, row.total) == ("Sort", 2, 20.0)
    assert row.parts == pytest.approx((8.0, 2.0, 3.0, 1.0, 1.0, 5.0))
    assert (times.unknown, times.workers) == (1, (2,))


def test_an_episode_that_was_played_again_counts_once(path: Path) -> None:
    record = sample_record(SORT, 0)
    for total in (99.0, 3.0):
        Journal(path).end(record, replace(TIMES, total=total))
    times = run_times(summarize(TASKS, [record]), read_entries(path))
    assert [row.total for row in times.rows] == [3.0]
    assert times.workers == (1,)


def test_attempts_are_counted_over_all_that_was_noted_before(path: Path) -> None:
    record = sample_record(SORT, 0, (), error="boom")
    for workers in (0, 3):
        journal = Journal(path, lambda: read_entries(path))
        journal.start("duobench eval", workers)
        journal.begin(record.key)
        journal.begin(record.key)
        journal.end(record, None)
    journal.begin(record.key)
    journal.lose(record.key, "worker")
    entries = read_entries(path)
    assert [each.attempt for each in entries if isinstance(each, Begun)] == [1, 2, 3, 4, 5]
    ended = [each for each in entries if isinstance(each, Ended)]
    assert [(each.how, each.attempt, each.workers) for each in ended] == [
        ("error", 2, 0),
        ("error", 4, 3),
        ("worker", 5, 0),
    ]
    assert journal.earlier(record.key) == ("stopped", "error", "stopped", "error")
    assert read_attempts(entries)[record.key] == (*journal.earlier(record.key), "worker")
    assert read_attempts(entries[1:])[record.key][0] == "stopped"
    journal.clear()
    assert journal.earlier(record.key) == ()


def test_attempts_go_on_after_those_of_two_folders(tmp_path: Path) -> None:
    record = sample_record(SORT, 0, ())
    paths = [tmp_path / name for name in ("a", "b")]
    for path, how in zip(paths, ("worker", "machinery"), strict=True):
        journal = Journal(path)
        journal.begin(record.key)
        journal.lose(record.key, how)

    def entries() -> list[Entry]:
        return [entry for path in paths for entry in read_entries(path)]

    for number in (3, 4):
        journal = Journal(paths[1], entries)
        journal.begin(record.key)
        assert len(journal.earlier(record.key)) + 1 == number
        journal.lose(record.key, "node")
        found = read_attempts(entries())[record.key]
        assert found == ("worker", "machinery", *["node"] * (number - 2))


def test_half_a_line_does_no_harm(path: Path) -> None:
    path.write_bytes(b'{"kind":"begun","task":"sort","condition":"a.sim.none.default","epis\xff')
    Journal(path).start("mine", 1)
    assert read_entries(path) == [Started(command="mine", workers=1)]
    assert read_entries(path.with_name("none")) == []


@pytest.mark.parametrize(
    ("workers", "writers", "said"),
    [
        ((1,), 1, "one after the other"),
        ((), 1, "one after the other"),
        ((4,), 1, "times of 4 workers side by side"),
        ((1, 8), 1, "times of 1 or 8 workers side by side"),
        ((1, 8), 4, "played by 4 writers"),
    ],
)
def test_page_says_whose_times_they_are(workers: tuple[int, ...], writers: int, said: str) -> None:
    assert said in side_by_side(workers, writers)


def test_durations_are_for_people() -> None:
    seconds = (0.0, 0.671, 9.97, 59.4, 60, 185, 3600, 7620)
    assert ", ".join(map(duration, seconds)) == (
        "0.00 s, 0.67 s, 10 s, 59 s, 1 min 00 s, 3 min 05 s, 1 h 00 min, 2 h 07 min"
    )
