"""The verbs `verify`, `bundle` and `report` take a run as a folder or as one file."""

import re
from pathlib import Path

import pytest

from duobench.results.folder import RunFolder
from tests.cli.conftest import Told, refusal
from tests.evaluation import toy_tasks
from tests.evaluation.forging import rewritten
from tests.results.samples import key, without_times


@pytest.fixture
def run(tmp_path: Path, told: Told) -> Path:
    words = ["--tasks", "bin_sort", "--episodes", "2", "--videos", "0", "--workers", "0"]
    told("eval", "--policy", "hold", "--out", tmp_path / "run", *words)
    return tmp_path / "run"


@pytest.mark.slow
def test_bundle_is_verified_and_reported_as_its_run(run: Path, told: Told) -> None:
    bundle, report = run.with_name("run.duobench.zip"), run.with_name("report")
    assert re.search(rf"Bundle: {bundle}, 2 records\nSHA-256: [0-9a-f]{{64}}", told("bundle", run))
    for source in (run, bundle):
        out = told("verify", source, "--workers", "0")
        assert "2 of 2 episodes" in out
        assert "2 episodes: exact 2, stages only 0" in out
        assert out.endswith("Verified.\n")
    told("report", bundle, "--out", report)
    pages = [(folder / "index.html").read_text() for folder in (report, run)]
    assert without_times(pages[0]) == without_times(pages[1])
    told("report", bundle, "--out", report)
    for words, message in (
        ((bundle, "--out", run), "holds a run, and no report of a bundle"),
        ((bundle,), "say with --out where"),
        ((run, "--out", run), "lies in the run's own folder"),
    ):
        assert message in refusal("report", *words)


@pytest.mark.long
def test_report_of_a_bundle_has_videos_too(run: Path, told: Told) -> None:
    told("bundle", run)
    out = run.with_name("report")
    words = ["report", run.with_name("run.duobench.zip"), "--out", out, "--videos", "bin_sort:1"]
    for said in ("1 video made\n", "0 videos made, 1 there before"):
        assert said in told(*words)
    video = 'src="videos/bin_sort/hold.sim.none.default/00001.webm"'
    assert video in (out / "index.html").read_text()


@pytest.mark.slow
def test_disagreement_is_one_line_and_fails(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = RunFolder(run).record(key(RunFolder(run), "bin_sort", 1))
    rewritten(path, lambda record: record.update(steps=9))
    assert refusal("verify", run, "--workers", "0") == "1"
    said = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("Contradicted: bin_sort, episode 1: ") for line in said) == 1
    assert any("Without what is contradicted; " in line for line in said)
    assert any(re.match(r" All tasks +1/2 +0\.0 ", line) for line in said)


@pytest.mark.slow
def test_unfinished_run_and_tasks_of_others_are_said(
    tmp_path: Path, told: Told, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    words = ["--tasks", toy_tasks.NOD_NAME, "--episodes", "6", "--videos", "0", "--workers", "0"]
    told("eval", "--policy", "hold", "--out", run, *words)
    RunFolder(run).record(key(RunFolder(run), "nod", 5)).unlink()
    refusal("verify", run, "--workers", "0")
    out = capsys.readouterr().out
    assert "Not verifiable: nod, episode 0, nod, episode 1, nod, episode 2 and 2 more: " in out
    assert "With --import-tasks" in out
    told("report", run)
    out = told("verify", run, "--workers", "0", "--import-tasks")
    assert "With --import-tasks" not in out
    for said in (out, told("bundle", run, "--out", tmp_path / "part.zip")):
        assert "The run is unfinished: no record of 1 episode." in said
