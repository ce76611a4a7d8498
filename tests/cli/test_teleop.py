"""`duobench teleop` as a command: its page, its recording, and what it says."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.data import ActorKind, DataSet
from duobench.spatial import SE3
from tests.teleop.operator import hand, message
from tests.web.pages import TIMEOUT_S, open_page

STEPS = 5


@contextmanager
def started(*words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The command in a process of its own, and the address that it prints."""
    command = [sys.executable, "-m", "duobench", "teleop", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            words = tuple(process.stdout.readline().split())
            yield process, words[-1]
        finally:
            process.kill()


def lead(url: str, first: int) -> None:
    """Open both hands, squeeze them for some steps, and leave."""
    with open_page(url) as page:
        page.say(kind="drive")
        page.hear_of("role", role="driver")
        for number in range(STEPS + 1):
            one = hand(SE3.at(z=0.002 * number), squeeze=float(number > 0))
            page.say(**json.loads(message(first + number, one, one)))
        page.hear_of("status", step=STEPS)
    with open_page(url) as page:
        assert page.hear_of("status", state="paused")["task"] == "carry_pot"


def test_ctrl_c_leaves_what_was_recorded_and_says_how_much(tmp_path: Path) -> None:
    out = tmp_path / "people"
    words = ("carry_pot", "--out", str(out), "--operator", "P07", "--scripted", "--lockstep")
    with started(*words, "--instruction", "Lift it.") as (process, url):
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=.+", url)
        lead(url, 0)
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode in {0, 130}, said
    assert "0 episodes of carry_pot in" in said
    (recording,) = DataSet.open(out).recordings()
    info = recording.info
    assert (info.actor.kind, info.actor.name) == (ActorKind.SCRIPTED_OPERATOR, "P07")
    assert info.instruction == "Lift it."
    assert info.task_instruction.startswith("Lift the pot")
    assert len(recording) == STEPS
    assert info.outcome is not None
    assert not info.outcome.kept


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["carry_pto"], "Did you mean 'carry_pot'"),
        (["carry_pot", "--leader", "gelo:x"], "--leader is gello:FILE or lerobot:KIND"),
        (["carry_pot", "--leader", "gello:x", "--lockstep"], "leave out --lockstep"),
        (["carry_pot", "--leader", "gello:nowhere.toml"], "nowhere.toml"),
        (["carry_pot", "--episodes", "0"], "at least one episode"),
        (["carry_pot", "--port", "70000"], "Cannot listen at 127.0.0.1:70000"),
    ],
)
def test_mistake_is_told_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        main(["teleop", *words, "--out", str(tmp_path / "out")])
    assert message in str(left.value.code)
