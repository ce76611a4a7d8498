"""Programs that lead a rig in a process of their own: what they print, and what they recorded."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from duobench.data import DataSet, Recording

ROOT = Path(__file__).parents[2]


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def begun(module: str, event: str, *words: object) -> subprocess.Popen[str]:
    """A program of this folder, once it has said that something has happened."""
    path = os.pathsep.join([str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    command = [sys.executable, "-m", f"tests.real.{module}", *map(str, words)]
    program = subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True
    )
    assert program.stdout is not None
    if (said := program.stdout.readline()) != f"{event}\n":
        kill(program)
        raise AssertionError(f"{module} said {said!r} instead of {event!r}.")
    return program


def kill(program: subprocess.Popen[str]) -> None:
    program.kill()
    with program:
        program.wait(10)


def end_of(program: subprocess.Popen[str], folder: Path) -> tuple[dict[str, Any], Recording]:
    """What it saw, as JSON; whatever happened, nothing that it recorded is lost."""
    assert program.stdout is not None
    with program:
        seen: dict[str, Any] = json.loads(program.stdout.readline())
        assert program.wait(60) == 0
    (recording,) = DataSet.open(folder).recordings()
    assert recording.info.outcome is not None
    assert recording.info.outcome.reason == seen["reason"]
    assert len(recording.sent) in {seen["steps"], seen["steps"] + 1}
    return seen, recording


def recovered(folder: Path) -> Recording:
    """What a program that was killed has recorded."""
    data = DataSet.open(folder)
    (partial,) = data.partials()
    data.recover(partial)
    (recording,) = data.recordings()
    return recording
