"""The verbs `verify`, `bundle` and `report` take a run as a folder or as one file."""

import re
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.files import write
from duobench.results.folder import RunFolder
from tests.evaluation import toy_tasks
from tests.evaluation.forging import rewritten
from tests.results.samples import key, without_times


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    words = ["--tasks", "bin_sort", "--episodes", "2", "--videos", "0", "--workers", "0"]
    main(["eval", "--policy", "hold", "--out", str(tmp_path / "run"), *words])
    capsys.readouterr()
    return tmp_path / "run"


def test_bundle_is_verified_and_reported_as_its_run(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["bundle", str(run)])
    bundle = run.with_name("run.duobench.zip")
    assert re.search(rf"Bundle: {bundle}, 2 records\nSHA-256: [0-9a-f]{{64}}", _out(capsys))
    for source in (run, bundle):
        main(["verify", str(source), "--workers", "0"])
        out = _out(capsys)
        assert "2 of 2 episodes" in out
        assert "2 episodes: exact 2, stages only 0" in out
        assert out.endswith("Verified.\n")
    main(["report", str(bundle), "--out", str(run.with_name("report"))])
    page = run.with_name("report") / "index.html"
    assert without_times(page.read_text()) == without_times((run / "index.html").read_text())
    main(["report", str(bundle), "--out", str(run.with_name("report"))])
    with pytest.raises(SystemExit, match="holds a run, and no report of a bundle"):
        main(["report", str(bundle), "--out", str(run)])
    with pytest.raises(SystemExit, match="say with --out where"):
        main(["report", str(bundle)])
    with pytest.raises(SystemExit, match="lies in the run's own folder"):
        main(["report", str(run), "--out", str(run)])


def test_report_of_a_bundle_has_videos_too(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["bundle", str(run)])
    out = run.with_name("report")
    words = ["--out", str(out), "--videos", "bin_sort:1"]
    for said in ("1 video made\n", "0 videos made, 1 there before"):
        main(["report", str(run.with_name("run.duobench.zip")), *words])
        assert said in _out(capsys)
    assert (
        'src="videos/bin_sort/hold.sim.none.default/00001.webm"' in (out / "index.html").read_text()
    )


def test_disagreement_is_one_line_and_fails(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rewritten(
        RunFolder(run).record(key(RunFolder(run), "bin_sort", 1)),
        lambda record: record.update(steps=9),
    )
    with pytest.raises(SystemExit) as left:
        main(["verify", str(run), "--workers", "0"])
    assert left.value.code == 1
    lines = [line for line in _out(capsys).splitlines() if line.startswith("Contradicted: ")]
    assert len(lines) == 1
    assert "bin_sort, episode 1: " in lines[0]


def test_unfinished_run_and_tasks_of_others_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    words = ["--tasks", toy_tasks.NOD_NAME, "--episodes", "6", "--videos", "0", "--workers", "0"]
    main(["eval", "--policy", "hold", "--out", str(run), *words])
    RunFolder(run).record(key(RunFolder(run), "nod", 5)).unlink()
    with pytest.raises(SystemExit):
        main(["verify", str(run), "--workers", "0"])
    out = _out(capsys)
    assert "Not verifiable: nod, episode 0, nod, episode 1, nod, episode 2 and 2 more: " in out
    assert "With --import-tasks" in out
    main(["verify", str(run), "--workers", "0", "--import-tasks"])
    out = _out(capsys)
    assert "The run is unfinished: no record of 1 episode." in out
    assert "With --import-tasks" not in out
    main(["bundle", str(run), "--out", str(tmp_path / "part.zip")])
    assert "The run is unfinished: no record of 1 episode." in _out(capsys)


@pytest.mark.parametrize("verb", ["verify", "bundle", "report"])
def test_what_holds_no_run_is_told_in_words(verb: str, tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="There is no folder"):
        main([verb, str(tmp_path / "nowhere")])
    write(tmp_path / "notes.zip", "no archive")
    words = ["--out", str(tmp_path / "out")] if verb == "report" else []
    with pytest.raises(SystemExit, match=r"error: .*(is no whole bundle|holds no evaluation)"):
        main([verb, str(tmp_path / "notes.zip"), *words])


def _out(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().out
