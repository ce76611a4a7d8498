"""What the operating system tells about processes, for tests that kill some."""

import os
import time
from collections.abc import Callable
from pathlib import Path

TIMEOUT_S = 120


def status(pid: int) -> tuple[str, int]:
    """State and parent of a process, as Linux tells them; a process that is gone is a zombie."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return "Z", 0
    return words[0], int(words[1])


def children(pid: int) -> list[int]:
    pids = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    return [child for child in pids if status(child)[1] == pid]


def workers(pid: int) -> list[int]:
    """Children that lead a process group of their own."""
    return [child for child in children(pid) if os.getpgid(child) == child]


def is_running(pid: int) -> bool:
    return status(pid)[0] not in {"Z", "X"}


def wait_until(condition: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < deadline, f"{what} within {TIMEOUT_S} s"
        time.sleep(0.02)
