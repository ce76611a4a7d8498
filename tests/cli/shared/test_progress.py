import io

import pytest
from rich.console import Console

from duobench.cli.shared.progress import EpisodesPlayed, display
from tests.results.samples import SORT, sample_record, sample_records, sample_run


def shown(*, terminal: bool, records: list, finished: int) -> str:
    out = io.StringIO()
    console = Console(file=out, force_terminal=terminal, width=100, color_system=None)
    run = sample_run(episodes=len(records) // 3)
    with display("episode", console) as live:
        played = EpisodesPlayed(live)
        played.on_run_start(run, records[:finished])
        for record in records[finished:]:
            played.on_episode(record)
    return out.getvalue()


def test_output_that_is_no_terminal_gets_few_plain_lines() -> None:
    records = sample_records(sample_run(episodes=40))
    text = shown(terminal=False, records=records, finished=0)
    lines = text.splitlines()
    assert lines[0] == "Policy mine: 3 tasks, 120 episodes"
    successes = sum(record.success for record in records)
    assert lines[-1] == f"120 of 120 episodes, {successes} succeeded"
    assert len(lines) == 11
    assert "\x1b" not in text
    assert "\r" not in text


def test_continued_run_says_what_was_there() -> None:
    records = sample_records(sample_run(episodes=4))
    lines = shown(terminal=False, records=records, finished=11).splitlines()
    assert lines[0] == "Policy mine: 3 tasks, 12 episodes, 11 already finished"
    assert lines[-1].startswith("12 of 12 episodes")


def test_broken_episode_is_told_with_its_reason() -> None:
    records = [
        *sample_records(sample_run(episodes=1))[:2],
        sample_record(SORT, 0, (), error="T\nE: x\n"),
    ]
    text = shown(terminal=False, records=records, finished=0)
    assert "sort, episode 0 failed with an error: E: x" in text


def test_one_is_not_told_as_several() -> None:
    out = io.StringIO()
    run = sample_run(tasks=(SORT,), episodes=1)
    with display("episode", Console(file=out, width=100)) as live:
        EpisodesPlayed(live).on_run_start(run, [])
    assert out.getvalue() == "Policy mine: 1 task, 1 episode\n"


def test_terminal_gets_a_bar_a_task() -> None:
    records = sample_records(sample_run(episodes=5))
    text = shown(terminal=True, records=records, finished=2)
    for task in ("lift", "sort", "turn"):
        assert task in text
    assert "5/5" in text


@pytest.mark.parametrize("terminal", [False, True])
def test_things_are_counted_from_where_an_earlier_call_stopped(terminal: bool) -> None:
    out = io.StringIO()
    console = Console(file=out, force_terminal=terminal, width=100, color_system=None)
    with display("frame", console) as live:
        for done in range(40, 101):
            live.tell(done, 100)
    if terminal:
        assert "100/100" in out.getvalue()
    else:
        lines = out.getvalue().splitlines()
        assert lines == [f"{done} of 100 frames" for done in range(40, 101, 10)]
