import re
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.errors import OtherRunError
from duobench.replay.verify import Verdict, verify
from duobench.results.robustness.conditions import read_robustness
from duobench.results.source import open_source
from duobench.results.suites.shard import Shard
from duobench.runners.shifts import evaluate_shifts
from duobench.shifts.shift import NO_SHIFT, SINGLE_AXES, Shift
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import small_suite

SHIFTS = (NO_SHIFT, *(Shift(axis=axis, level=5) for axis in (*SINGLE_AXES, "all")))


def contents(folder: Path) -> dict[str, bytes]:
    paths = sorted(folder.glob("*/records/*/*.json"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("robust") / "run"
    evaluate_shifts("random", small_suite(episodes=2), out, SHIFTS, workers=0)
    return out


def test_every_condition_is_a_run_that_is_verified(played: Path) -> None:
    found = read_robustness(played)
    assert tuple(found.conditions) == SHIFTS
    for shift in SHIFTS:
        reader = open_source(played / shift.name)
        for record in reader.read_records(run := reader.read_run()):
            assert record.config.shift == run.config.shift == shift
            assert record.execution.latency == (10 if shift.level_of("latency") else 0)
        verified = verify(reader, import_tasks=True)
        assert len(verified.of(Verdict.EXACT)) == 4


def test_layouts_are_the_same_but_on_the_axis_layout(played: Path) -> None:
    def layouts(shift: Shift) -> list[object]:
        reader = open_source(played / shift.name)
        return [record.layout for record in reader.read_records(reader.read_run())]

    usual = layouts(NO_SHIFT)
    for shift in SHIFTS:
        assert (layouts(shift) == usual) is (shift.level_of("layout") == 0)


def test_it_goes_on_where_it_was_and_workers_do_not_matter(played: Path, tmp_path: Path) -> None:
    suite, out = small_suite(episodes=2), tmp_path / "run"
    evaluate_shifts("random", suite, out, SHIFTS[:2], workers=2)
    evaluate_shifts("random", suite, out, SHIFTS[:4], workers=0)
    kept = {name: content for name, content in contents(played).items() if name in contents(out)}
    assert contents(out) == kept
    assert len(kept) == 16
    with pytest.raises(OtherRunError, match="policy hold instead of random"):
        evaluate_shifts("hold", suite, out, SHIFTS[:2], workers=0)


def test_each_condition_has_the_videos_that_are_asked_for(tmp_path: Path) -> None:
    out = tmp_path / "run"
    words = ["--suite", "robust", "--axes", "look", "--levels", "5", "--episodes", "2"]
    words += ["--workers", "0", "--tasks", toy_tasks.WAVE_NAME, "--out", str(out)]
    main(["eval", "--policy", "hold", *words, "--videos", "1"])
    for condition in ("none", "look-5"):
        assert len(list((out / condition).rglob("*.webm"))) == 1


def test_shards_of_conditions_are_read_as_one(played: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    for number in (1, 2):
        shard = Shard(number=number, count=2)
        evaluate_shifts("random", small_suite(episodes=2), out, SHIFTS[:3], workers=0, shard=shard)
    whole, parts = read_robustness(played), read_robustness(out)
    for shift in SHIFTS[:3]:
        assert parts.conditions[shift].results == whole.conditions[shift].results


def test_episodes_with_errors_are_told_and_played_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(toy_tasks.MARKS, str(tmp_path))
    words = ["eval", "--policy", f"{toy_tasks.__name__}:BreaksOnce", "--suite", "robust"]
    words += ["--axes", "camera", "--levels", "1", "--episodes", "2", "--workers", "0"]
    words += ["--tasks", toy_tasks.WAVE_NAME, "--out", str(tmp_path / "run")]
    with pytest.raises(SystemExit):
        main(words)
    assert "1 episode failed with an error" in capsys.readouterr().out
    main([*words, "--retry-broken"])
    assert "failed" not in capsys.readouterr().out
    main([*words, "--fresh"])
    assert "4 of 4 episodes" in capsys.readouterr().out


def test_a_condition_with_another_shift_is_another_run(played: Path) -> None:
    run = open_source(played / "none").read_run()
    assert replace(run, command="").differences(run.under(SHIFTS[1]))


def test_the_command_plays_two_levels_of_a_few_axes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "run")
    words = ["--suite", "robust", "--levels", "1", "5", "--episodes", "1", "--workers", "0"]
    words += ["--tasks", toy_tasks.WAVE_NAME, "--out", out]
    main(["eval", "--policy", "hold", *words])
    said = capsys.readouterr().out
    assert "17 of 17 episodes" in said
    page = (tmp_path / "run" / "index.html").read_text()
    assert "suite robust 1 with 1 of 11 tasks, 1 episodes instead of 20" in page.replace("\n", " ")
    assert len(list((tmp_path / "run").glob("*-5"))) == 8
    assert not list((tmp_path / "run").rglob("*.webm"))
    main(["verify", out, "--import-tasks", "--workers", "0"])
    assert capsys.readouterr().out.count("Verified.") == 17
    main(["report", out])
    assert re.search(r"Report: .*run/index\.html", capsys.readouterr().out)
    for extra, message in (
        (["--axes", "sight"], "Unknown axis of a shift 'sight'"),
        (["--levels", "6"], "Levels of a shift are 1 to 5"),
        (["--shift", "look-1"], "has shifts of its own"),
    ):
        with pytest.raises(SystemExit, match=message):
            main(["eval", "--policy", "hold", *words, *extra])
    with pytest.raises(SystemExit, match="go with --suite robust"):
        main(["eval", "--policy", "hold", "--out", out, "--levels", "1"])
