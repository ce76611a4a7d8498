"""The page on verification: its commands and its code run, in their order."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from duobench.replay.verify import Verdict
from tests.docs.markdown import DOCS, blocks, table

PAGE = DOCS / "verification.md"


def test_commands_and_code_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (commands,) = blocks(PAGE, "sh")
    outputs = []
    for line in commands.splitlines():
        command = [sys.executable, "-P", "-m", *shlex.split(line)]
        result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout + result.stderr
        outputs.append(result.stdout)
    assert "2 episodes: exact 2," in outputs[1]
    assert outputs[3].endswith("Verified.\n")
    assert (tmp_path / "expert-report" / "index.html").exists()
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(PAGE, "python")
    exec(code, {})
    assert capsys.readouterr().out == "True\n"


def test_the_table_has_every_verdict() -> None:
    assert [row["verdict"] for row in table(PAGE, "verdict")] == list(Verdict)
