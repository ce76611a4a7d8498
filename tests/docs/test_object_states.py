"""The page on object states: its example reads them, and its policy plays."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from duobench.results.folder import RunFolder
from tests.docs.markdown import DOCS, blocks, modules

PAGE = DOCS / "object_states.md"


def test_the_examples_run_as_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exec(blocks(PAGE, "python")[0], {})
    assert "white_cube_x 0." in capsys.readouterr().out
    for name, code in modules(PAGE).items():
        (tmp_path / name).write_text(code, encoding="utf-8")
    (line,) = blocks(PAGE, "sh")
    command = [sys.executable, "-P", "-m", *shlex.split(line)]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "my_states:MyStates (privileged)" in result.stdout
    assert RunFolder(tmp_path / "runs" / "states").read_run().config.object_state
