"""The page on leaderboards: its commands run, and its numbers are those of the code."""

import shlex
import subprocess
import sys
from pathlib import Path

from duobench.results.leaderboard.protocol import EPISODES
from tests.docs.markdown import DOCS, blocks, text_of

PAGE = DOCS / "leaderboard.md"


def test_commands_run(tmp_path: Path) -> None:
    (commands,) = blocks(PAGE, "sh")
    for line in commands.splitlines():
        command = [sys.executable, "-P", "-m", *shlex.split(line)]
        result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout + result.stderr
    assert "Not ranked: expert, success 100.0 % " in result.stdout
    assert (tmp_path / "site" / "index.html").exists()
    assert (tmp_path / "site" / "leaderboard.json").exists()


def test_numbers_are_those_of_the_code() -> None:
    page = text_of(PAGE).replace("\n", " ")
    assert f"episodes 0 to {EPISODES - 1} of each" in page
    assert f"--episodes {EPISODES} " in page
