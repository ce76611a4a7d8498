"""The gallery: its script draws a task."""

import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from duobench.scene.cameras import OVERVIEW, POLICY_CAMERAS
from duobench.tasks import catalog

ROOT = Path(__file__).parents[2]
TASK = "carry_pot"
BLANK = 5.0
"""Standard deviation of the brightness of a picture on which there is little to see."""


def test_the_script_draws_a_task(tmp_path: Path) -> None:
    command = [sys.executable, "docs/gallery.py", TASK, "--out", str(tmp_path)]
    result = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    drawn = {file.stem: file for file in (tmp_path / "gallery" / TASK).iterdir()}
    stages = {f"stage_{number}" for number in range(1, catalog.get(TASK).max_stage + 1)}
    assert set(drawn) == {OVERVIEW, *POLICY_CAMERAS} | stages
    for file in drawn.values():
        with Image.open(file) as picture:
            assert np.asarray(picture.convert("L")).std() > BLANK, file.name
