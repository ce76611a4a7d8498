import io
import os
import pty
import subprocess
import sys
from collections.abc import Mapping

import pytest
from rich.console import Console

from duobench.cli.shared.console import NOTEBOOK
from duobench.cli.shared.progress import EpisodesPlayed, display
from tests.children import ran
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
    assert lines[-1].startswith(f"120 of 120 episodes, {successes} succeeded, 0:00:")
    assert len(lines) == 11
    assert "\x1b" not in text
    assert "\r" not in text


def test_continued_run_says_what_was_there() -> None:
    records = sample_records(sample_run(episodes=4))
    lines = shown(terminal=False, records=records, finished=11).splitlines()
    assert lines[0] == "Policy mine: 3 tasks, 12 episodes, 11 already finished"
    assert lines[-1].startswith("12 of 12 episodes")


def test_first_minute_in_which_nothing_is_done_says_how_long_it_has_taken() -> None:
    out, now = io.StringIO(), [0.0]
    with display("episode", Console(file=out, width=100), clock=lambda: now[0]) as live:
        live.begin("Recording", {"sort": 6})
        now[0] = 65.0
        live.advance("sort", 0)
        live.advance("sort", 2, earlier=True)
        now[0] = 200.0
        live.advance("sort", 0)
    assert out.getvalue().splitlines()[1:] == [
        "0 of 6 episodes, 0:01:05 elapsed",
        "2 of 6 episodes, 0:03:20 elapsed",
    ]


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
        assert [line.partition(",")[0] for line in lines] == [
            f"{done} of 100 frames" for done in range(40, 101, 10)
        ]


def test_plain_lines_have_the_time_that_is_past_and_the_time_that_is_left() -> None:
    out, now = io.StringIO(), 50.0
    with display("frame", Console(file=out, width=100), clock=lambda: now) as live:
        for done in range(20, 101, 20):  # the first twenty were there before
            live.tell(done, 100)
            now += 30.0
    assert out.getvalue().splitlines() == [
        "20 of 100 frames",
        "40 of 100 frames, 0:00:30 elapsed, 0:01:30 left",
        "60 of 100 frames, 0:01:00 elapsed, 0:01:00 left",
        "80 of 100 frames, 0:01:30 elapsed, 0:00:30 left",
        "100 of 100 frames, 0:02:00 elapsed",
    ]


def test_slow_work_is_told_before_its_first_tenth_and_ever_less_often() -> None:
    out, now = io.StringIO(), 0.0
    with display("frame", Console(file=out, width=100), clock=lambda: now) as live:
        for done in range(100):
            live.tell(done, 1000)
            now += 25.0
    assert out.getvalue().splitlines() == [
        "0 of 1000 frames",
        "3 of 1000 frames, 0:01:15 elapsed, 6:55:25 left",
        "6 of 1000 frames, 0:02:30 elapsed, 6:54:10 left",
        "12 of 1000 frames, 0:05:00 elapsed, 6:51:40 left",
        "24 of 1000 frames, 0:10:00 elapsed, 6:46:40 left",
        "48 of 1000 frames, 0:20:00 elapsed, 6:36:40 left",
        "96 of 1000 frames, 0:40:00 elapsed, 6:16:40 left",
    ]


SHOWN = """
from duobench.cli.shared.console import say
from duobench.cli.shared.progress import display
say("coloured", style="bold red")
with display("frame") as live:
    for done in range(6):
        live.tell(done, 5)
"""


def on_terminal(code: str, environment: Mapping[str, str]) -> str:
    """What Python writes to a terminal of its own."""
    ours, theirs = pty.openpty()
    with subprocess.Popen([sys.executable, "-c", code], stdout=theirs, env=environment) as child:
        os.close(theirs)
        text = b""
        try:
            while part := os.read(ours, 4096):
                text += part
        except OSError:  # Linux's way to say that nothing follows
            os.close(ours)
    assert child.returncode == 0
    return text.decode()


@pytest.mark.parametrize("variables", [{}, {"JPY_PARENT_PID": "1"}])
def test_a_terminal_has_bars_and_a_notebook_plain_lines(variables: dict[str, str]) -> None:
    """A notebook gives programs a terminal, and asks for colours by variables."""
    asked = {"TERM": "xterm-color", "FORCE_COLOR": "1", "CLICOLOR_FORCE": "1"}
    environment = {name: each for name, each in os.environ.items() if name not in NOTEBOOK}
    text = on_terminal(SHOWN, {**environment, **asked, **variables})
    assert ("\x1b" in text) == (not variables)
    assert ("3 of 5 frames, 0:00:0" in text) == bool(variables)


def test_a_pipe_gets_no_escape_codes_whatever_is_asked_for() -> None:
    done = ran("-c", SHOWN, env={**os.environ, "FORCE_COLOR": "1", "TERM": "xterm-color"})
    assert "5 of 5 frames" in done.stdout
    assert "\x1b" not in done.stdout, done.stderr
