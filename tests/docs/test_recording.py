"""The page on recording: its commands and its code run, in their order."""

import shlex
import subprocess
import sys
from pathlib import Path

from tests.docs.markdown import DOCS, blocks

PAGE = DOCS / "recording.md"


def test_commands_and_code_run(tmp_path: Path) -> None:
    def run(*command: str) -> str:
        result = subprocess.run(
            [sys.executable, "-P", *command],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    (commands,) = blocks(PAGE, "sh")
    outputs = [run("-m", *shlex.split(line)) for line in commands.splitlines()]
    assert "1 episode, 0 problems" in outputs[-1]
    own, reading = (run("-c", code) for code in blocks(PAGE, "python"))
    assert "00000.parquet 30 steps" in own
    assert "cut=True" in own
    assert "(96, 96, 3)" in reading
    assert "bit-exact: True" in reading
