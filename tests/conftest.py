"""What holds for every test."""

import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

# Whoever runs the tests in the background of a script ignores SIGINT, and so would every process
# that a test starts; some tests interrupt theirs.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as it is published, built once."""
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=Path(__file__).parents[1], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="session")
def demonstrations(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Data sets of experts, each recorded once for all workers of a session.

    `demonstrations("bin_sort", episodes=2)` is the folder that `duobench record --tasks bin_sort
    --episodes 2` writes. It is everybody's: who changes something in it, or goes on recording,
    copies it before.
    """
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:  # each has a folder of its own in a common one
        shared = shared.parent

    def recorded(task: str, *, episodes: int = 1, variety: str = "human") -> Path:
        folder = shared / "demonstrations" / f"{task}-{episodes}-{variety}"
        folder.parent.mkdir(exist_ok=True)
        what = ["--tasks", task, "--episodes", str(episodes), "--variety", variety]
        command = [sys.executable, "-P", "-m", "duobench", "record", *what, "--out", str(folder)]
        with folder.with_suffix(".recorded").open("a") as done:
            fcntl.flock(done, fcntl.LOCK_EX)
            if not done.seek(0, os.SEEK_END):
                subprocess.run(command, check=True, capture_output=True)
                done.write(" ".join(command))
        return folder

    return recorded
