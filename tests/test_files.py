import os
import signal
import subprocess
import sys
from pathlib import Path

from duobench.files import remove_temporary, write


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
    failed = child(script, path)
    assert f"OutputError: Cannot write {path}: File too large. Nothing" in failed.stderr
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def child(script: str, path: Path) -> subprocess.CompletedProcess[str]:
    source = str(Path(__file__).parents[1] / "src")
    return subprocess.run(
        [sys.executable, "-c", script, str(path)],
        env={**os.environ, "PYTHONPATH": source},
        check=False,
        capture_output=True,
        text=True,
    )


def test_killed_writer_leaves_rubbish_that_is_removed(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from duobench.files import write\n"
        "os.fsync = lambda _file: os.kill(os.getpid(), signal.SIGKILL)\n"
        "write(Path(sys.argv[1]), 'new')\n"
    )
    path = tmp_path / "deep" / "a.txt"
    killed = child(script, path)
    assert killed.returncode == -signal.SIGKILL
    assert not path.exists()
    assert list(path.parent.iterdir())
    remove_temporary(tmp_path)
    assert not list(path.parent.iterdir())
