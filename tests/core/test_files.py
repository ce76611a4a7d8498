from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from duobench.core.errors import (
    DuoBenchError,
    EvaluationError,
    FileError,
    LeaderError,
    OtherRunError,
    ServingError,
)
from duobench.core.files import (
    begin_or_continue,
    decode,
    differences,
    read_object,
    remove_abandoned,
    remove_temporary,
    taken_back,
    write,
)
from duobench.policy.serving.access import read_key
from duobench.policy.serving.message_format import read_format
from duobench.real.rig import Rig
from duobench.results.salt import Salt, read_rounds, read_salt
from duobench.teleop.leaders.gello import GelloConfig
from tests.children import ran
from tests.real.test_rig_file import RIGHT
from tests.teleop.leaders.test_gello import FILE as LEADERS


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
        "from duobench.core.files import write\n"
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
        "from duobench.core.files import write\n"
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


MARK = "\ufeff"
"""What some editors put before a text."""
ROUNDS = '[[round]]\nname = "autumn"\ndate = 2026-09-01\nsalt_sha256 = "{}"\n'
BY_PEOPLE = {
    "format.toml": (lambda path: read_format(str(path)), 'prompt = "task"\n', ServingError),
    "key.txt": (read_key, "word\n", ServingError),
    "salt.txt": (read_salt, "ab" * 32, EvaluationError),
    "rounds.toml": (read_rounds, ROUNDS.format(Salt("ab" * 32).sha256), EvaluationError),
    "rig.json": (Rig.read, json.dumps(RIGHT), FileError),
    "leaders.toml": (GelloConfig.read, LEADERS, LeaderError),
    "config.json": (lambda path: read_object(path, FileError), '{"a": 1}', FileError),
}
"""What reads each file that people write, such a file, and the error where it is none."""


@pytest.mark.parametrize("name", BY_PEOPLE)
def test_file_that_people_write_may_begin_with_a_byte_order_mark(tmp_path: Path, name: str) -> None:
    read, text, _ = BY_PEOPLE[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    plain = read(path)
    path.write_text(MARK + text.replace("\n", "\r\n"), encoding="utf-8")
    assert read(path) == plain


@pytest.mark.parametrize(
    "name", sorted(BY_PEOPLE.keys() - {"config.json"})
)  # its reader takes UTF-16
def test_file_in_another_encoding_is_refused_in_a_sentence(tmp_path: Path, name: str) -> None:
    read, text, error = BY_PEOPLE[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-16")
    with pytest.raises(error, match=name) as refused:
        read(path)
    assert "\n" not in str(refused.value)
    if name != "salt.txt":  # whose errors show none of it
        assert "it is UTF-16" in str(refused.value)


DEEP = 100_000
NESTED = {
    "toml lists": f"a = {'[' * DEEP}",
    "toml dots": f"left.port{'.a' * 1000} = 1",
    "json lists": "[" * DEEP,
    "json maps": '{"arms":' * DEEP,
    "json whole": f'{{"a": {"[" * DEEP}{"]" * DEEP}}}',
}


@pytest.mark.parametrize("name", sorted(BY_PEOPLE.keys() - {"key.txt"}))  # which may be any word
@pytest.mark.parametrize("text", NESTED.values(), ids=NESTED)
def test_deeply_nested_file_is_refused_in_a_sentence(tmp_path: Path, name: str, text: str) -> None:
    read, _, _ = BY_PEOPLE[name]
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(DuoBenchError) as refused:
        read(path)
    assert len(str(refused.value).splitlines()) == 1
    assert "recursion" not in str(refused.value)


@pytest.mark.parametrize("text", NESTED.values(), ids=NESTED)
def test_deeply_nested_file_of_ours_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(FileError) as refused:
        decode(text, Plan, 1)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("before", "made", "left"),
    [
        (None, ["plan.json", "log/a.jsonl"], None),
        (None, [], None),
        ([], ["plan.json"], []),
        (None, ["plan.json", "records/1.json"], ["plan.json", "records/1.json"]),
        (["mine.txt"], ["plan.json"], ["mine.txt", "plan.json"]),
    ],
)
def test_new_folder_is_taken_back_where_nothing_has_begun(
    tmp_path: Path, before: list[str] | None, made: list[str], left: list[str] | None
) -> None:
    def fill(names: list[str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for name in names:
            write(folder / name, "x")

    folder = tmp_path / "runs" / "deep" / "new"
    if before is not None:
        fill(before)
    with suppress(ZeroDivisionError), taken_back(folder, "plan.json", "log/*.jsonl"):
        fill(made)
        raise ZeroDivisionError
    if left is None:
        assert list(tmp_path.iterdir()) == []
        return
    files = (path for path in folder.rglob("*") if path.is_file())
    assert sorted(path.relative_to(folder).as_posix() for path in files) == left
    with taken_back(folder, "*"):
        fill(["more"])
    assert (folder / "more").exists()
