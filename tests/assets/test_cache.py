import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from duobench.assets.cache import cache_dir, locked, write_atomic
from duobench.errors import AssetError

HOLD = """
import pathlib, sys, time
from duobench.assets.cache import locked
with locked(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""
COUNT = """
import pathlib, sys
from duobench.assets.cache import locked
folder = pathlib.Path(sys.argv[1])
counter = folder / "counter"
for _ in range(50):
    with locked(folder):
        counter.write_text(str(int(counter.read_text()) + 1))
"""


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_cache_folder_is_chosen_by_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DUOBENCH_CACHE", raising=False)
    assert cache_dir() == tmp_path / "xdg" / "duobench"
    monkeypatch.setenv("DUOBENCH_CACHE", str(tmp_path / "mine"))
    assert cache_dir() == tmp_path / "mine"


def test_without_any_choice_it_is_the_platform_cache(monkeypatch):
    for name in ("DUOBENCH_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert cache_dir() == Path.home() / ".cache" / "duobench"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert cache_dir() == Path.home() / "Library" / "Caches" / "duobench"
    monkeypatch.setattr(sys, "platform", "win32")
    assert cache_dir() == Path.home() / "AppData" / "Local" / "duobench" / "cache"


def test_a_write_replaces_the_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "deep" / "file"
    write_atomic(path, b"old")
    write_atomic(path, b"new")
    assert path.read_bytes() == b"new"
    assert names_in(path.parent) == ["file"]


def test_written_files_follow_the_umask(tmp_path):
    before = os.umask(0o022)
    try:
        write_atomic(tmp_path / "file", b"data")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o644


def test_a_failed_write_keeps_the_old_file(tmp_path):
    path = tmp_path / "file"
    path.mkdir()  # a folder cannot be replaced by a file
    (path / "kept").touch()
    with pytest.raises(AssetError, match="DUOBENCH_CACHE"):
        write_atomic(path, b"data")
    assert names_in(tmp_path) == ["file"]
    assert names_in(path) == ["kept"]


def test_a_cache_below_a_file_is_a_clear_error(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(AssetError, match="DUOBENCH_CACHE"),
        locked(tmp_path / "file" / "cache"),
    ):
        pass


def test_one_process_at_a_time_holds_the_lock(tmp_path):
    (tmp_path / "counter").write_text("0")
    command = [sys.executable, "-c", COUNT, str(tmp_path)]
    processes = [subprocess.Popen(command) for _ in range(4)]
    assert [process.wait() for process in processes] == [0] * 4
    assert (tmp_path / "counter").read_text() == "200"


def test_a_killed_process_leaves_no_lock_behind(tmp_path):
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    with locked(tmp_path):
        pass
