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
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from duobench.cli.shared import rigs
from duobench.cli.shared.rigs import KeyTerminal
from duobench.data import DataSet
from duobench.data.stream import read_left
from duobench.real.sessions.operator import QUIT
from tests.cli.test_cli import ROOT
from tests.real.simulated import simulated_file
from tests.web.pages import TIMEOUT_S, wait_until

RECORD = ("real", "record", "--policy", "hold", "--task", "bin_sort")
CTRL_C = "\x03"


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
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)]),
            "PYTHONUNBUFFERED": "",  # as where nobody set it: streams hold what is not printed
        },
        start_new_session=True,
        preexec_fn=own,  # noqa: PLW1509 - it starts no thread and takes no lock
    ) as process:
        os.close(slave)
        try:
            yield Terminal(master, process)
        finally:
            process.kill()


def wait_until_played(folder: Path) -> None:
    """Wait until the policy has led for some steps: before, a hold costs no episode."""
    data = DataSet(folder)
    wait_until(lambda: any(len(read_left(path)[1]) for path in data.partials()))


def test_lost_terminal_holds_the_arms_and_keeps_what_was_recorded(tmp_path: Path) -> None:
    words = ("--rig", str(simulated_file(tmp_path)), "--out", str(tmp_path / "data"))
    with terminal(*RECORD, *words, "--horizon", "9000") as operator:
        for words, key in (("h: Nobody is near", "h"), ("p: Placed", "p"), ("It plays", "1")):
            operator.until(words)
            operator.press(key)
        wait_until_played(tmp_path / "data")
        os.close(operator.master)
        assert operator.process.wait(60) == 1  # there is nobody to say more to
    (episode,) = DataSet(tmp_path / "data").recordings()
    assert episode.info.outcome is not None
    assert not episode.info.outcome.kept
    assert list(DataSet(tmp_path / "data").partials()) == []


def test_ctrl_c_at_a_question_leaves_the_next_one_to_hold(tmp_path: Path) -> None:
    rig = str(simulated_file(tmp_path))
    out = str(tmp_path / "data")
    words = ("--rig", rig, "--out", out, "--horizon", "9000", "--episodes", "1")
    with terminal(*RECORD, *words) as operator:
        operator.until("h: Nobody is near")
        operator.press(CTRL_C)
        operator.until("The arms are held")
        for key, words_then in (("h", "p: Placed"), ("p", "It plays")):
            operator.press(key)
            operator.until(words_then)
        wait_until_played(Path(out))
        operator.press(CTRL_C)
        operator.until("k: keep it")
        operator.press("q")
        operator.until("0 episodes of bin_sort")
        assert operator.process.wait(60) == 0


@pytest.fixture
def keys() -> Iterator[tuple[int, KeyTerminal]]:
    """A terminal in this process, and what writes into it."""
    master, slave = pty.openpty()
    with closing(KeyTerminal(slave)) as made:
        yield master, made
    os.close(master)
    os.close(slave)


SLOW = TIMEOUT_S
"""Rest after Escape on a machine as slow as any; the usual one is over between two pieces."""


@pytest.mark.parametrize(
    ("pieces", "rest_s", "pressed"),
    [
        # Delete, page up, an arrow, F1, Alt-3; then keys that are characters.
        ([b"\x1b[3~\x1b[5~\x1b[1;5C\x1bOP\x1b3", b"4\x1b s"], SLOW, "4 s"),
        ([b"2\x1b", b"[3", b"~", b"4"], SLOW, "24"),
        ([b" \x1b"], SLOW, " "),
        ([b"\x1b", b"q"], 0.1, "q"),
    ],
    ids=("no characters", "in pieces", "before escape", "after escape"),
)
def test_keys_that_are_no_characters_are_none_of_ours(
    keys: tuple[int, KeyTerminal],
    pieces: list[bytes],
    rest_s: float,
    pressed: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rigs, "_REST_S", rest_s)
    master, terminal = keys
    found: list[str] = []
    terminal.listen(found.append)
    for piece in pieces:
        os.write(master, piece)
        time.sleep(0.02 if rest_s == SLOW else 5 * rest_s)
    wait_until(lambda: pressed[-1] in found)
    assert "".join(found) == pressed


def test_question_ends_when_the_session_does(
    keys: tuple[int, KeyTerminal], capfd: pytest.CaptureFixture[str]
) -> None:
    _, terminal = keys
    threading.Timer(0.05, terminal.leave).start()
    assert terminal.ask("h: go home", "h") == QUIT
    assert terminal.ask("h: go home", "h") == QUIT
    assert "the session ends" in capfd.readouterr().err


def test_ctrl_c_at_a_later_question_of_leading_ends_the_session(tmp_path: Path) -> None:
    rig = str(simulated_file(tmp_path))
    words = ("real", "teleop", "bin_sort", "--rig", rig, "--out", str(tmp_path / "data"))
    with terminal(*words) as operator:
        keys = (("Open http", ""), ("h: Nobody is near", "h"), ("p: Placed", " "))
        for awaited, key in (*keys, ("h: Nobody is near", CTRL_C)):
            operator.until(awaited)
            operator.press(key)
        operator.until("the session ends")
        operator.until("0 episodes of bin_sort")
        assert operator.process.wait(60) == 0
