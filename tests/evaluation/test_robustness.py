import re
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.core.errors import OtherRunError
from duobench.evaluation.replay.verify import Verdict, verify
from duobench.evaluation.runners.evaluate import evaluate
from duobench.results.folder import RunFolder
from duobench.results.report import read_parts
from duobench.tasks.shifts.shift import NO_SHIFT, SINGLE_AXES, Shift
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import small_suite

SHIFTS = (NO_SHIFT, *(Shift(axis=axis, level=5) for axis in (*SINGLE_AXES, "all")))


def contents(folder: RunFolder) -> dict[str, bytes]:
    paths = sorted(folder.path.glob("records/*/*/*.json"))
    return {str(path.relative_to(folder.path)): path.read_bytes() for path in paths}


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = RunFolder(tmp_path_factory.mktemp("robust") / "run")
    evaluate("random", small_suite(episodes=2, shifts=SHIFTS), folder, workers=0)
    return folder


def test_every_condition_is_in_the_records_and_verified(played):
    parts = read_parts(played)
    assert tuple(part.condition.shift for part in parts) == SHIFTS
    for part in parts:
        shift = part.condition.shift
        for record in part.records:
            assert record.config.shift == shift
            assert record.execution.latency == (10 if shift.level_of("latency") else 0)
    assert len(verify(played, import_tasks=True).of(Verdict.EXACT)) == 4 * len(SHIFTS)


def test_layouts_are_the_same_but_on_the_axis_layout(played):
    usual, *others = read_parts(played)
    for part in others:
        is_same = [each.layout for each in part.records] == [each.layout for each in usual.records]
        assert is_same is (part.condition.shift.level_of("layout") == 0)


def test_it_goes_on_where_it_was_and_workers_do_not_matter(played, tmp_path):
    folder = RunFolder(tmp_path / "run")
    evaluate("random", small_suite(episodes=2, shifts=SHIFTS[:2]), folder, workers=2)
    evaluate("random", small_suite(episodes=2, shifts=SHIFTS[:4]), folder, workers=0)
    found = contents(folder)
    kept = {name: content for name, content in contents(played).items() if name in found}
    assert found == kept
    assert len(kept) == 16
    with pytest.raises(OtherRunError, match="policy hold instead of random"):
        evaluate("hold", small_suite(episodes=2, shifts=SHIFTS[:2]), folder, workers=0)


def words(folder: Path, policy: str, *more: str) -> list[str]:
    """A command that plays the suite robust."""
    where = ["--tasks", toy_tasks.WAVE_NAME, "--out", str(folder), "--workers", "0"]
    return ["eval", "--policy", policy, "--suite", "robust", *where, *more]


def test_each_condition_has_the_videos_that_are_asked_for(tmp_path):
    more = ("--axes", "look", "--levels", "5", "--episodes", "2", "--videos", "1")
    main(words(tmp_path, "hold", *more))
    for shift in ("none", "look-5"):
        name = f"hold.sim.{shift}.default"
        (video,) = tmp_path.glob(f"videos/wave/{name}/*.webm")
        page = tmp_path / "conditions" / name / "index.html"
        (link,) = re.findall(r'<video [^>]*src="([^"]*)"', page.read_text())
        assert (page.parent / link).resolve() == video.resolve()


def test_episodes_with_errors_are_told_and_played_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(toy_tasks.MARKS, str(tmp_path))
    more = ("--axes", "camera", "--levels", "1", "--episodes", "2")
    command = words(tmp_path / "run", f"{toy_tasks.__name__}:BreaksOnce", *more)
    with pytest.raises(SystemExit):
        main(command)
    assert "1 episode failed with an error" in capsys.readouterr().out
    main([*command, "--retry-broken"])
    assert "failed" not in capsys.readouterr().out
    main([*command, "--fresh"])
    assert "4 of 4 episodes" in capsys.readouterr().out


def test_the_command_plays_two_levels_of_a_few_axes(tmp_path, capsys):
    command = words(tmp_path, "hold", "--levels", "1", "5", "--episodes", "1")
    main(command)
    said = capsys.readouterr().out
    assert "17 of 17 episodes" in said
    page = (tmp_path / "index.html").read_text()
    assert "suite robust 1 with 1 of 11 tasks, 1 episodes instead of 20" in page.replace("\n", " ")
    assert len(list((tmp_path / "conditions").glob("*-5.default"))) == 8
    assert not list(tmp_path.rglob("*.webm"))
    main(["verify", str(tmp_path), "--import-tasks", "--workers", "0"])
    assert "17 episodes: exact 17" in capsys.readouterr().out
    main(["report", str(tmp_path)])
    assert re.search(r"Report: .*index\.html", capsys.readouterr().out)
    for extra, message in (
        (["--axes", "sight"], "Unknown axis of a shift 'sight'"),
        (["--levels", "6"], "Levels of a shift are 1 to 5"),
        (["--shift", "look-1"], "has shifts of its own"),
    ):
        with pytest.raises(SystemExit, match=message):
            main([*command, *extra])
    with pytest.raises(SystemExit, match="are chosen of the suite robust"):
        main(["eval", "--policy", "hold", "--out", str(tmp_path), "--levels", "1"])
