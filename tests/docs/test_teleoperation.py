"""The page on teleoperation: its code runs, and its file is one."""

import subprocess
import sys
from pathlib import Path

from duobench.teleop.leaders.gello_config import GelloConfig
from tests.docs.markdown import DOCS, blocks

PAGE = DOCS / "teleoperation.md"


def test_code_runs(tmp_path: Path) -> None:
    (code,) = blocks(PAGE, "python")
    result = subprocess.run(
        [sys.executable, "-P", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    lines = result.stdout.splitlines()
    assert lines[0].startswith("waiting 0 Squeeze")
    assert lines[3].startswith("recording 3")
    assert lines[-1] == "0 episodes"


def test_the_file_of_leader_arms_is_one(tmp_path: Path) -> None:
    (text,) = blocks(PAGE, "toml")
    path = tmp_path / "gello.toml"
    path.write_text(text)
    assert GelloConfig.read(path).left.signs[5] == -1
