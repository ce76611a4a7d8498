"""The page of printed parts is that of the recipes, and its pictures are all there and not old."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image
from prints import APART, SIZE, together
from prints_page import DRAWN, FOLDER, JOBS, PAGE, digest, job, page, together_file

from duobench.fabrication.details import details
from tests.docs.markdown import DOCS, links

MAX_BYTES = 1_500_000
BLANK = 5.0
"""Standard deviation of the brightness of a picture on which there is little to see."""
PICTURES = {f"{name}.jpg" for name in JOBS if job(name).parts} | set(map(together_file, APART))


def test_the_page_is_that_of_the_recipes() -> None:
    assert page(DOCS / FOLDER) == (DOCS / PAGE).read_text(encoding="utf-8"), "run: make docs"


def test_all_pictures_are_there_and_shown() -> None:
    assert {path.name for path in (DOCS / FOLDER).glob("*.jpg")} == PICTURES
    shown = {link.partition("/")[2] for link in links(DOCS / PAGE) if link.startswith(f"{FOLDER}/")}
    assert shown == PICTURES
    assert sum(path.stat().st_size for path in (DOCS / FOLDER).iterdir()) < MAX_BYTES


@pytest.mark.parametrize("name", sorted(PICTURES))
def test_there_is_something_to_see(name: str) -> None:
    with Image.open(DOCS / FOLDER / name) as image:
        assert image.size == SIZE[::-1]
        assert np.asarray(image.convert("L"), dtype=float).std() > BLANK


def test_pictures_are_not_older_than_the_parts() -> None:
    drawn = json.loads((DOCS / FOLDER / DRAWN).read_text(encoding="utf-8"))
    assert drawn == {name: digest(job(name)) for name in JOBS}, "run: make docs"


def test_whatever_is_put_together_is_shown_so() -> None:
    assert {name for name, task in details().items() if task.assembly} <= set(APART)
    counts = {name: len(list(together(name))) for name in APART}
    assert counts == {
        "hinge_chest": 6,  # box, lid, two screws with heads
        "ball_maze": 6,
        "join_blocks": 3,
        "transfer_gate": 3,
        "transfer_reorient": 2,
    }
