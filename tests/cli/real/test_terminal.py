"""The operator's terminal at a rig: a real one, of a process of its own."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from duobench.data import DataSet
from tests.cli.test_cli import ROOT

RECORD = ("real", "record", "--policy", "hold", "--rig", "simulated", "--task", "bin_sort")


class Terminal:
    """A window in which a command runs."""

    def __init__(self, master: int, process: subprocess.Popen[bytes]) -> None:
        self.master, self.process, self._said = master, process, ""

    def until(self, words: str) -> None:
        """Read until words are said that were not read before."""
        while not (found := re.search(words, self._said)):
            self._said += os.read(self.master, 65536).decode()
        self._said = self._said[found.end() :]

    def press(self, key: str) -> None:
        os.write(self.master, key.encode())


@contextmanager
def terminal(*words: str) -> Iterator[Terminal]:
    """A command in a terminal that it belongs to, as in a window of its own."""

    def own() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may ignore it
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    master, slave = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "duobench", *words],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        start_new_session=True,
        preexec_fn=own,  # noqa: PLW1509 - it starts no thread and takes no lock
    ) as process:
        os.close(slave)
        try:
            yield Terminal(master, process)
        finally:
            process.kill()


def test_lost_terminal_holds_the_arms_and_keeps_what_was_recorded(tmp_path: Path) -> None:
    with terminal(*RECORD, "--out", str(tmp_path), "--horizon", "9000") as operator:
        for words, key in (("h: they go home", "h"), ("p: placed", "p"), ("It plays", "1")):
            operator.until(words)
            operator.press(key)
        os.close(operator.master)
        assert operator.process.wait(60) == 1  # there is nobody to say more to
    (episode,) = DataSet(tmp_path).recordings()
    assert episode.info.outcome is not None
    assert not episode.info.outcome.kept
    assert list(DataSet(tmp_path).partials()) == []
