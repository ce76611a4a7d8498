import io
import re

import pytest
from rich.console import Console

from duobench.cli.shared.console import numeric, results_table, table, whole
from tests.results.samples import (
    DEGREES,
    LIFT,
    SORT,
    part_of,
    sample_record,
    sample_records,
    sample_run,
)


def printed(
    run_records: list, expected: int, width: int = 130, policy: str = "mine", overtime: float = 1.0
) -> list[str]:
    out, run = io.StringIO(), sample_run(episodes=expected, policy=policy, overtime=overtime)
    Console(file=out, width=width, soft_wrap=True).print(results_table(part_of(run, run_records)))
    return [re.sub(r"\s{2,}", "|", line.strip()) for line in out.getvalue().splitlines()]


def test_row_has_rate_interval_progress_and_distribution() -> None:
    records = [sample_record(SORT, episode, (1, 2, 3)) for episode in range(3)]
    records.append(sample_record(SORT, 3, (5,)))
    lines = printed(records, expected=4)
    assert "sort|4|75.0|30.1–95.4|0.833|0:0|1:1|2:0|3:3" in lines
    assert "lift|0/4|–|0.0–100.0|–|0:0|1:0|2:0" in lines
    assert "All tasks|4/12|75.0|30.1–95.4|0.833" in lines
    assert not any("Errors" in line for line in lines)
    assert any(
        "2:5 says that five episodes came to stage 2 and no further" in line for line in lines
    )


def test_late_successes_have_a_column_where_episodes_were_played_on() -> None:
    records = [sample_record(SORT, episode, (1, 2, 3)) for episode in range(2)]
    records += [sample_record(SORT, 2, (5,), late_success=100), sample_record(SORT, 3, (5,))]
    lines = printed(records, expected=4, overtime=1.5)
    assert "sort|4|50.0|15.0–85.0|0.667|75.0|0:0|1:2|2:0|3:2" in lines
    assert "Within 1.5 horizons is no score: scores end at the horizon." in lines
    assert not any("ithin" in line for line in printed(records, expected=4))


def test_a_sentence_says_that_targets_look_like_degrees() -> None:
    records = [sample_record(SORT, 0, (5,), clipped=80, excess=DEGREES)]
    text = " ".join(printed(records, expected=1))
    assert "90 where 2.9 is the limit (are these degrees?)." in text
    assert "Limits" not in " ".join(printed([sample_record(SORT, 0, (5,), clipped=9)], expected=1))


def test_category_of_several_tasks_has_a_row() -> None:
    run = sample_run()
    lines = printed(sample_records(run), run.suite.episodes)
    assert any(line.startswith("bimanual manipulation|8|") for line in lines)
    assert not any(line.startswith("parallel execution") for line in lines)


def test_broken_episodes_are_shown() -> None:
    lines = printed([sample_record(LIFT, 0, (), error="boom")], expected=1)
    assert any(line.startswith("Task|Episodes|Errors") for line in lines)
    assert any(line.startswith("lift|1|1|0.0|") for line in lines)


def test_privileged_policy_is_marked_above_the_numbers() -> None:
    assert printed([], expected=1)[0] == "mine"
    assert printed([], expected=1, policy="expert:human")[0] == "expert:human (privileged)"


@pytest.mark.parametrize("width", [80, 60, 20])
def test_narrow_terminal_still_shows_every_number(width: int) -> None:
    run = sample_run()
    wide, narrow = (
        " ".join(printed(sample_records(run), run.suite.episodes, width=columns))
        for columns in (130, width)
    )
    assert sorted(re.findall(r"[\w.–:/]+", narrow)) == sorted(re.findall(r"[\w.–:/]+", wide))


@pytest.mark.parametrize("width", [80, 60, 20])
def test_columns_of_numbers_are_never_cut(width: int) -> None:
    rows = table(whole("Task"), *numeric("Median", "99 %", "Horizon"))
    rows.add_row("transfer_reorient", "133", "138", "505")
    out = io.StringIO()
    Console(file=out, width=width, soft_wrap=True).print(rows)
    assert re.sub(r"[─\s]+", " ", out.getvalue()).split() == [
        "Task",
        "Median",
        "99",
        "%",
        "Horizon",
        "transfer_reorient",
        "133",
        "138",
        "505",
    ]
