"""Observers that a user names by an import path."""

from pathlib import Path

import pytest

from duobench.cli import main
from duobench.core.errors import ImportPathError, UnknownNameError
from duobench.evaluation.observers import ObserverError, load_observer
from duobench.results.folder import RunFolder
from tests.cli.conftest import refusal
from tests.docs.markdown import blocks, page_of
from tests.evaluation import toy_tasks

MODULE = """
from pathlib import Path

class Counts:
    def on_run_start(self, run, finished):
        self.said(f"start {run.candidate.policy} {len(finished)}")

    def on_episode(self, played):
        self.said(f"{played.task} {played.episode}")

    def said(self, text):
        with Path("told.txt").open("a") as file:
            print(text, file=file)

class Crashes(Counts):
    def on_episode(self, played):
        super().on_episode(played)
        raise ValueError("no connection")

class CannotBeMade(Counts):
    def __init__(self):
        raise OSError("no key")

class NeedsMore(Counts):
    def __init__(self, folder): ...

class Deaf:
    def on_episode(self, played): ...

def make():
    return Counts()

ready = Counts()
number = 3
"""


@pytest.fixture(autouse=True)
def _mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.parametrize("name", ["Counts", "make", "ready"])
def test_class_function_and_object_are_observers(name: str) -> None:
    load_observer(f"mine:{name}").on_episode(toy_episode())
    assert Path("told.txt").read_text() == "wave 3\n"


def toy_episode() -> object:
    return type("Episode", (), {"task": "wave", "episode": 3})()


@pytest.mark.parametrize(
    ("path", "kind", "message"),
    [
        ("mine", ImportPathError, "is no `module:attribute`, such as my_module:NAME"),
        ("mine.py:Counts", ImportPathError, "found by its name: mine:Counts"),
        ("no_such:Counts", ImportPathError, "no module named 'no_such'"),
        ("mine:Conts", UnknownNameError, "Did you mean 'Counts'"),
        ("mine:number", UnknownNameError, "of type int, has no observer"),
        ("mine:CannotBeMade", ObserverError, "(?s)cannot be made.*OSError: no key"),
        ("mine:NeedsMore", ObserverError, "(?s)cannot be made.*missing 1 required .*'folder'"),
        ("mine:Deaf", ObserverError, r"of type Deaf; an observer has .*on_run_start\(run, fini"),
    ],
)
def test_what_is_no_observer_is_told(path: str, kind: type[Exception], message: str) -> None:
    with pytest.raises(kind, match=message):
        load_observer(path)


def words(*observers: str, workers: int = 0) -> list[str]:
    named = [word for name in observers for word in ("--observer", f"mine:{name}")]
    small = ["--tasks", toy_tasks.WAVE_NAME, "--episodes", "2", "--videos", "0"]
    return ["eval", "--policy", "hold", "--out", "run", *small, "--workers", str(workers), *named]


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_command_tells_several_observers(workers: int) -> None:
    main(words("Counts", "make", workers=workers))
    said = Path("told.txt").read_text().splitlines()
    assert said[:2] == ["start hold 0"] * 2
    assert sorted(said[2:]) == ["wave 0", "wave 0", "wave 1", "wave 1"]
    main(words("Counts", workers=workers))
    assert Path("told.txt").read_text().splitlines()[6:] == ["start hold 2"]
    assert "--observer" not in (Path("run") / "run.json").read_text()


def test_observer_that_crashes_is_named_and_loses_nothing() -> None:
    said = refusal(*words("Crashes"))
    assert said.startswith("error: Observer 'mine:Crashes' has failed")
    assert "ValueError: no connection" in said
    folder = RunFolder(Path("run"))
    assert len(folder.finished(folder.read_run())) == 1


def test_bad_observer_is_told_before_anything_is_written() -> None:
    assert "Did you mean 'Counts'" in refusal(*words("Conts"))
    assert not Path("run").exists()


def test_observer_of_the_page_prints(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = blocks(page_of("evaluation"), "python")
    Path("observers.py").write_text(code)
    main([*words(), "--observer", "observers:Prints"])
    said = capsys.readouterr().out.splitlines()
    assert "hold 0 finished before" in said
    assert "wave 1 False 0" in said
