from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from duobench.errors import FileError, OtherRunError
from duobench.files import begin_or_continue, differences, remove_abandoned, remove_temporary, write
from tests.children import ran


def test_file_appears_with_its_bytes_and_nothing_else(tmp_path: Path) -> None:
    write(tmp_path / "deep" / "a.txt", "ä\n")
    assert (tmp_path / "deep" / "a.txt").read_bytes() == "ä\n".encode()
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["a.txt"]


def test_write_that_fails_leaves_the_old_file_and_says_why(tmp_path: Path) -> None:
    """A limit on the size of files stands for a full disk: the system refuses in the same way."""
    path = tmp_path / "a.txt"
    write(path, "old")
    script = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "from duobench.files import write\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))\n"
        "write(Path(sys.argv[1]), 'new' * 100)\n"
    )
    failed = ran("-c", script, str(path))
    assert f"OutputError: Cannot write {path}: File too large. Nothing" in failed.stderr
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_killed_writer_leaves_rubbish_that_is_removed(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from duobench.files import write\n"
        "os.fsync = lambda _file: os.kill(os.getpid(), signal.SIGKILL)\n"
        "write(Path(sys.argv[1]), 'new')\n"
    )
    path = tmp_path / "deep" / "a.txt"
    killed = ran("-c", script, str(path))
    assert killed.returncode == -signal.SIGKILL
    assert not path.exists()
    assert list(path.parent.iterdir())
    remove_temporary(tmp_path)
    assert not list(path.parent.iterdir())


@dataclass(frozen=True)
class Plan:
    look: str = "dark"
    files: dict[str, int] = field(default_factory=dict)

    def differences(self, other: Plan) -> list[str]:
        return differences(vars(self), vars(other))


def begin(folder: Path, plan: Plan, **options: bool) -> None:
    begin_or_continue(folder, folder / "meta" / "plan.json", plan, 1, what="plan", **options)


def test_what_a_killed_process_left_goes_and_what_a_living_one_writes_stays(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    films = tmp_path / "bin_sort"
    films.mkdir()
    names = {f".0.webm.{who}.tmp" for who in (dead.pid, os.getpid(), "x", 10**30)}
    for name in names | {"0.webm", f".0.json.{dead.pid}.tmp"}:
        (films / name).touch()
    before = {path.name for path in films.iterdir()}
    remove_abandoned(tmp_path, ".webm")
    assert {path.name for path in films.iterdir()} == before - {f".0.webm.{dead.pid}.tmp"}


def test_folder_is_begun_once_and_then_holds_nothing_else(tmp_path: Path) -> None:
    folder, plan = tmp_path / "new", Plan(files={"a": 1, "b": 2})
    begin(folder, plan)
    before = (folder / "meta" / "plan.json").read_bytes()
    (folder / "result.txt").write_text("42")
    begin(folder, plan)
    other = Plan(look="light", files={"b": 3, "c": 4, "d": 5})
    message = "another plan; this one has look light instead of dark; files 2 added, 1 removed, 1 c"
    with pytest.raises(OtherRunError, match=message):
        begin(folder, other)
    begin(folder, other, is_final=False)
    assert (folder / "meta" / "plan.json").read_bytes() == before
    (folder / "meta" / "plan.json").write_text("{}")
    with pytest.raises(FileError, match=r"Cannot read .*plan\.json"):
        begin(folder, other, is_final=False)


def test_folder_of_something_else_is_not_begun(tmp_path: Path) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / ".plan.json.7.tmp").write_text("{")  # of one that was killed
    (tmp_path / ".notes.txt.tmp").write_text("precious")
    with pytest.raises(OtherRunError, match="is not empty and holds no plan"):
        begin(tmp_path, Plan())
    (tmp_path / ".notes.txt.tmp").unlink()
    begin(tmp_path, Plan())


def test_what_was_not_known_before_makes_no_difference() -> None:
    assert differences({"a": 1, "b": 2}, {"a": 1, "c": 3}) == []
