from pathlib import Path

import pytest

from duobench.results.folder import RunFolder
from duobench.results.metrics import summarize
from duobench.results.reporting.times import (
    EpisodeTimes,
    duration,
    read_notes,
    run_times,
    side_by_side,
)
from tests.results.samples import LIFT, SORT, TASKS, sample_record

TIMES = EpisodeTimes(total=10.0, simulation=4.0, rendering=1.0, policy=1.5, waiting=0.5, video=0.5)


def test_times_add_up_by_task_with_their_rest(tmp_path: Path) -> None:
    records = [sample_record(SORT, 0), sample_record(SORT, 1), sample_record(LIFT, 0, (5,))]
    folder = RunFolder(tmp_path)
    for record in records[:2]:
        folder.note_timing(record, TIMES, workers=2)
    folder.note_timing(records[2], None, workers=1)
    times = run_times(summarize(TASKS, records), read_notes(folder.timing))
    (row,) = times.rows
    assert (row.label, row.episodes, row.total) == ("Sort", 2, 20.0)
    assert row.parts == pytest.approx((8.0, 2.0, 3.0, 1.0, 1.0, 5.0))
    assert (times.unknown, times.workers) == (1, (2,))


def test_an_episode_that_was_played_again_counts_once(tmp_path: Path) -> None:
    record = sample_record(SORT, 0)
    folder = RunFolder(tmp_path)
    for total in (99.0, 3.0):
        folder.note_timing(
            record,
            EpisodeTimes(total=total, simulation=0, rendering=0, policy=0, waiting=0, video=0),
            workers=0,
        )
    times = run_times(summarize(TASKS, [record]), read_notes(folder.timing))
    assert [row.total for row in times.rows] == [3.0]
    assert times.workers == (1,)


def test_earlier_notes_and_damaged_lines_do_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "timing.jsonl"
    path.write_bytes(
        b'{"task": "sort", "episode": 0, "steps": 3, "seconds": 2.5}\n'
        b'{"task": "lift", "episode": 0, "steps": 3, "seconds": 1.5}\n'
        b'{"task": "sort", "episode": 1, "st\xff\n'
    )
    records = [sample_record(SORT, 0), sample_record(LIFT, 0, (5,)), sample_record(SORT, 1)]
    times = run_times(summarize(TASKS, records), read_notes(path))
    assert [(row.label, row.total, row.parts) for row in times.rows] == [
        ("Lift <It>", 1.5, ()),
        ("Sort", 2.5, ()),
        ("All tasks", 4.0, ()),
    ]
    assert (times.unknown, times.workers) == (1, (None,))
    assert read_notes(tmp_path / "none") == {}


@pytest.mark.parametrize(
    ("workers", "said"),
    [
        ((1,), "one after the other"),
        ((), "one after the other"),
        ((4,), "times of 4 workers side by side"),
        ((1, 8), "times of 1 or 8 workers side by side"),
        ((None, 8), "It is not known"),
    ],
)
def test_page_says_whose_times_they_are(workers: tuple[int | None, ...], said: str) -> None:
    assert said in side_by_side(workers)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.0, "0.00 s"),
        (0.671, "0.67 s"),
        (9.97, "10 s"),
        (59.4, "59 s"),
        (60, "1 min 00 s"),
        (185, "3 min 05 s"),
        (3600, "1 h 00 min"),
        (7620, "2 h 07 min"),
    ],
)
def test_durations_are_for_people(seconds: float, said: str) -> None:
    assert duration(seconds) == said
