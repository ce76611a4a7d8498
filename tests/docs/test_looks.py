"""The page of the looks: it names all of them, its code runs, its images are there and not old."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from looks import DRAWN, FOLDER, NAMES, sources
from PIL import Image

from duobench.looks.catalog import LOOKS, look
from duobench.tasks import catalog

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
TEXT = (DOCS / "looks.md").read_text(encoding="utf-8")
MAX_BYTES = 1_500_000
TASK = "transfer_cube"


def test_it_names_every_look_and_every_task() -> None:
    table = re.findall(r"(?m)^\| `([a-z_]+)` \|", TEXT)
    assert table == list(LOOKS)
    assert set(LOOKS) <= set(NAMES)
    for name in NAMES:
        look(name)
    titles = re.findall(r"(?m)^### (.+)$", TEXT)
    assert titles == [catalog.get(name).title for name in catalog.names()]


def test_every_image_is_linked_and_small() -> None:
    linked = {DOCS / target for target in re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT)}
    images = set((DOCS / FOLDER).glob("*.jpg"))
    assert linked == images
    assert sum(file.stat().st_size for file in images) < MAX_BYTES


def test_the_images_are_not_old() -> None:
    kept = json.loads((DOCS / FOLDER / DRAWN).read_text(encoding="utf-8"))
    assert kept == sources(), "run: make docs"


@pytest.mark.parametrize("code", re.findall(r"(?s)```python\n(.*?)```", TEXT))
def test_the_code_runs(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_the_script_draws_a_task(tmp_path: Path) -> None:
    command = [sys.executable, "docs/looks.py", TASK, "--out", str(tmp_path)]
    result = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    (file,) = (tmp_path / FOLDER).iterdir()
    with Image.open(file) as image:
        assert np.asarray(image).std() > 20
