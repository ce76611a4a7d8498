"""The page on recording on real arms: its commands run, with an operator who is a script."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from duobench.cli.real.rigs import KeyTerminal
from duobench.data import DataSet
from tests.docs.markdown import DOCS, blocks, table

PAGE = DOCS / "real_recording.md"
ANSWERS = {"h: they go home": "h", "p: placed": "p", "k: keep it": "k", "h: go home": "q"}
"""What the operator answers; the session of teleoperation is ended at once."""
MORE = {"export": ["--cameras", "head", "--size", "32", "48"], "train": ["--print"]}
"""What makes commands shorter."""


def lines() -> list[list[str]]:
    return [
        shlex.split(line)[1:] for block in blocks(PAGE, "sh") for line in block.splitlines() if line
    ]


def run(words: list[str], folder: Path) -> str:
    """Run a command, and answer what it asks."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "duobench", *words, *MORE.get(words[0], [])],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    said = ""
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        for line in process.stdout:
            said += line
            for question, answer in ANSWERS.items():
                if question in line:
                    process.stdin.write(answer)
                    process.stdin.flush()
    assert process.returncode == 0, said
    return said


def test_commands_run_in_their_order(tmp_path: Path) -> None:
    outputs = [run(words, tmp_path) for words in lines()]
    record, teleop, check, info = outputs[1:5]
    assert "1 episode of transfer_cube in real-demos" in record
    assert "1 episode of transfer_cube" in teleop
    assert "1 episode, 0 problems" in check
    assert "1 real (simulated, simulated drivers)" in info
    (recording,) = DataSet(tmp_path / "real-demos").recordings()
    assert len(recording) > 30
    for output, words in zip(outputs, lines(), strict=True):
        if words[0] == "train":
            assert "lerobot-train" in output


def test_the_page_lists_the_keys() -> None:
    keys = " ".join(row["keys"] for row in table(PAGE, "when"))
    for key in ("h: the arms go home", "p: placed", "space: hold", "s: solved", "u: undo"):
        assert key in keys


@pytest.mark.parametrize("text", [b"xk", b"xyzk"])
def test_a_pipe_is_a_terminal(text: bytes) -> None:
    reading, writing = os.pipe()
    with KeyTerminal(reading) as terminal:
        os.write(writing, text)
        os.close(writing)
        assert terminal.ask("Keep it?", "kdq") in {"k", "q"}
        assert terminal.ask("And now?", "kdq") == "q"  # nobody is there any more
    os.close(reading)
