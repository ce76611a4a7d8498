"""Recordings of a task of one's own: they say where it is, and what reads them asks first."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

import duobench
from duobench.cli import main
from duobench.core.errors import DataError, ForeignTaskError, OptionError, UnknownNameError
from duobench.data import Actor, DataSet, Recorder, Recording, find_problems, summarize
from duobench.data.card import write_data_card
from duobench.evaluation.replay.sources import open_view
from duobench.tasks import catalog
from tests.envs.tools import wave

SOURCE = """
from dataclasses import replace
from duobench.tasks.bin_sort import TASK as BIN_SORT
TASK = replace(BIN_SORT, id="my_sort")
OTHER = replace(BIN_SORT, id="another")
SAME = replace(BIN_SORT, horizon=100)
"""
PATH = "sorts_of_mine:TASK"


@pytest.fixture(scope="module")
def demos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("own")
    (folder / "sorts_of_mine.py").write_text(SOURCE, encoding="utf-8")
    sys.path.insert(0, str(folder))
    record(folder / "demos", PATH)
    return folder / "demos"


@pytest.fixture(autouse=True)
def _importable(demos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(demos.parent))


def record(path: Path, task: object) -> None:
    env = Recorder(duobench.make(task, cameras=False), path, Actor(name="me"))  # type: ignore[arg-type]
    env.reset(seed=0)
    for number in range(4):
        env.step(wave(number))
    env.close()


def test_they_say_where_the_task_is(demos: Path, tmp_path: Path) -> None:
    (info,) = [each.info for each in DataSet.open(demos).recordings()]
    assert (info.task, info.reference) == ("my_sort", PATH)
    record(tmp_path, "duobench/bin_sort-v1")
    (info,) = [each.info for each in DataSet.open(tmp_path).recordings()]
    assert (info.task, info.reference) == ("bin_sort", "bin_sort")


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "data info {}",
        "data card {}",
        "export lerobot {} --out {}/../out",
        "export lerobot {} --out {}/../out --cameras none --object-state",
        "replay {} --mode actions",
        "replay {} --out {}/../videos --cameras head --size 32 32",
    ],
)
def test_what_reads_them_imports_it_only_if_told(
    demos: Path, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    call = words.format(*[demos] * words.count("{}")).split()
    with pytest.raises(SystemExit) as refused:
        main(call)
    assert "sorts_of_mine:TASK' is not in the benchmark" in str(refused.value)
    assert "--import-tasks" in str(refused.value)
    if "{}/../out" in words:
        call[4] = str(demos.parent / f"out{len(words)}")
    main([*call, "--import-tasks"])
    assert capsys.readouterr().out


def test_a_card_names_it_and_commands_that_import_it(demos: Path) -> None:
    text = write_data_card(demos, "me/demos", "mit", import_tasks=True).read_text(encoding="utf-8")
    assert "in 1 task of DuoBench" in text
    assert "Not of the benchmark: my_sort." in text
    assert "duobench data check data --import-tasks" in text


@pytest.mark.slow
def test_a_check_offers_to_import_it(demos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["data", "check", str(demos)])
    assert "--import-tasks" in capsys.readouterr().out
    main(["data", "check", str(demos), "--workers", "2", "--import-tasks"])
    assert "0 problems" in capsys.readouterr().out


def test_a_view_of_them_shows_it(demos: Path) -> None:
    with pytest.raises(ForeignTaskError):
        open_view(str(demos)).load("my_sort/00000")
    source = open_view(str(demos), import_tasks=True)
    assert len(source.load("my_sort/00000").poses()) == 5
    source.close()


def test_a_recording_of_the_task_itself_is_read_where_its_path_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path / "demos", catalog.get(PATH))
    demos = str(tmp_path / "demos")
    with pytest.raises(SystemExit):
        main(["data", "check", demos])
    assert "--import-tasks" not in capsys.readouterr().out, "it would not help"
    out = ["--out", str(tmp_path / "out"), "--cameras", "none"]
    main(["export", "lerobot", demos, "--tasks", PATH, *out, "--object-state"])
    main(["replay", demos, "--tasks", PATH, "--mode", "actions"])
    source = open_view(demos, tasks=[PATH])
    assert len(source.load("my_sort/00000").poses()) == 5
    source.close()


def test_a_task_with_the_id_of_another_is_refused() -> None:
    with pytest.raises(OptionError, match="has a task 'bin_sort', and sorts_of_mine:SAME is"):
        duobench.make("sorts_of_mine:SAME")
    assert catalog.get("duobench.tasks.bin_sort:TASK") is catalog.get("bin_sort")


def test_where_nobody_said_where_it_is_that_is_the_reason(demos: Path, tmp_path: Path) -> None:
    record(tmp_path, catalog.get(PATH))
    with pytest.raises(UnknownNameError, match="nothing says where it is"):
        summarize(DataSet.open(tmp_path, import_tasks=True))
    (path,) = DataSet.open(demos).episodes()
    info = Recording.read_info(path)
    wrong = DataSet.open(demos, import_tasks=True)
    with pytest.raises(DataError, match="is the task 'another', not 'my_sort'"):
        wrong.reference(replace(info, reference="sorts_of_mine:OTHER"))
    assert not find_problems(wrong)
