"""The page on robustness: its numbers are those of the code, and its commands run."""

import math
from pathlib import Path

import pytest

from dev.benchmarks.bounds import EPISODES, Job, Outcome, missing, play, read, run, table
from duobench.randomness import SUITE_VERSION
from duobench.results.suite import SUITES
from duobench.shifts import levels
from duobench.shifts.shift import AXES, LEVELS
from duobench.tasks import catalog
from tests.docs.markdown import DOCS, text_of
from tests.docs.markdown import table as table_of

PAGE = DOCS / "robustness.md"


def numbers(row: dict[str, str]) -> list[float]:
    cells = list(row.values())[2:]
    return [float(cell.rstrip(" °%m")) for cell in cells]


def test_table_of_axes_has_the_numbers_of_the_code() -> None:
    rows = table_of(PAGE, "axis")
    assert [row["axis"] for row in rows if row["axis"]] == list(AXES[:-1])
    shown = [numbers(row) for row in rows[1:]]
    expected = [
        [1000 * each for each in levels.CAMERA_METRES],
        [math.degrees(each) for each in levels.CAMERA_RADIANS],
        [1000 * each for each in levels.MARGIN_METRES],
        [math.degrees(each) for each in levels.MARGIN_RADIANS],
        levels.MASS_FACTORS,
        levels.FRICTION_FACTORS,
        levels.SPRING_FACTORS,
        [100 * each for each in levels.REWORDED_SHARE],
        [100 * each for each in levels.IMAGE_NOISE],
        [100 * each for each in levels.DROPPED_SHARE],
        [1000 * each for each in levels.JOINT_NOISE],
        levels.LATENCY_STEPS,
    ]
    assert levels.JOINT_NOISE == levels.POSE_NOISE
    assert len(shown) == len(expected)
    for row, values in zip(shown, expected, strict=True):
        assert row == pytest.approx(list(values)[1:])
    page = text_of(PAGE)
    assert f"under each of {len(SUITES['robust'].shifts) - 1}" in page.replace("\n", " ")
    episodes = 3 * LEVELS * len(catalog.names()) * EPISODES
    assert f"({episodes:,} episodes" in page


def test_bounds_are_measured_and_go_on_where_they_were(tmp_path: Path) -> None:
    job = Job(task="bin_sort", axis="latency", level=1, episodes=(0, 1))
    (first, second) = play(job)
    assert first.success
    assert first.steps > 100
    out = tmp_path / "bounds.jsonl"
    run([], out, 1)
    line = f'{{"suite": "{SUITE_VERSION}", "task": "bin_sort", "axis": "latency", "level": 1, '
    line += '"episode": 0, '
    out.write_text(line + '"stage": 4, "success": true, "steps": 150}\n' + line)
    done = read(out)
    assert len(done) == 1
    assert missing([job], done) == [Job(task="bin_sort", axis="latency", level=1, episodes=(1,))]
    assert missing([job], [first, second]) == []
    failed = Outcome(**{**{n: getattr(first, n) for n in Outcome.__slots__}, "success": False})
    assert "| `bin_sort` | **1/2** |" in table([first, failed], "latency")
