"""The gallery: its page is that of the catalog, its images are all there and not old."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gallery import COVER, DRAWN, PAGE, moments
from gallery_page import page
from gallery_shots import FOLDER, LATER, SHOTS, shot
from gallery_sources import model_digest, sources
from PIL import Image

from duobench.robot.cameras import OVERVIEW
from duobench.scene.compose import compose
from duobench.tasks import catalog
from duobench.types import POLICY_CAMERAS
from tests.golden import episodes

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MAX_BYTES = 3_000_000
BLANK = 5.0
"""Standard deviation of the brightness of an image on which there is little to see."""
TASK = "carry_pot"


@pytest.fixture(scope="module")
def text() -> str:
    return (DOCS / PAGE).read_text(encoding="utf-8")


def images() -> set[Path]:
    return set((DOCS / FOLDER).rglob("*.jpg"))


def test_the_page_is_that_of_the_catalog(text: str) -> None:
    assert page(DOCS / FOLDER) == text, "run: make docs"


@pytest.mark.parametrize("name", catalog.names())
def test_it_names_the_task_and_its_stages(name: str, text: str) -> None:
    task = catalog.get(name)
    section = text.partition(f"### {task.title}\n")[2].partition("### ")[0]
    assert f"`{name}`" in section
    assert str(task.category) in section
    assert f"{task.horizon} control steps" in section
    assert ("printable" in section) is task.printable
    assert ("real robot" in section) is task.real
    named = [
        number
        for number, stage in enumerate(task.stages, start=1)
        if re.search(rf"(?m)\b{number}\. {re.escape(stage.name)}", section)
    ]
    assert named == list(range(1, task.max_stage + 1))


def test_every_image_is_linked_and_every_link_leads_to_one(text: str) -> None:
    linked = {DOCS / target for target in re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)}
    assert linked
    assert linked == images()


def test_the_images_are_small_together() -> None:
    assert sum(file.stat().st_size for file in {DOCS / COVER, *images()}) < MAX_BYTES


@pytest.mark.parametrize("name", catalog.names())
def test_the_images_are_not_old(name: str) -> None:
    task, seed = catalog.get(name), str(shot(name).seed)
    reached = episodes.read()["tasks"][name][seed]["stages"]
    file = DOCS / FOLDER / name / DRAWN
    kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else None
    assert kept == sources(task, reached), "run: make docs"


def test_what_is_drawn_tells_one_model_from_another() -> None:
    task = catalog.get(TASK)
    painted = replace(task.props[0].solid, rgba=(1.0, 0.0, 0.0, 1.0))
    others = [
        replace(task, props=(replace(task.props[0], solid=painted), *task.props[1:])),
        replace(task, overview=replace(task.overview, fovy_deg=30.0)),
        catalog.get("transfer_cube"),
    ]
    assert model_digest(task) == model_digest(replace(task, title="Another title"))
    assert len({model_digest(one) for one in (task, *others)}) == 1 + len(others)


def test_stages_are_drawn_a_moment_later_but_before_the_next() -> None:
    reached = [(50, 1), (60, 2), (200, 4), (210, 5)]
    assert list(moments(reached)) == [(55, 1), (60 + LATER, 2), (205, 4), (210, 5)]
    assert list(moments([(7, 1)])) == [(7, 1)]


def test_shots_are_of_tasks_and_from_inside_the_room() -> None:
    assert set(SHOTS) <= set(catalog.names())
    for plan in SHOTS.values():
        for view in {plan.view, plan.last or plan.view}:
            compose((), view)


def test_the_script_draws_a_task(tmp_path: Path) -> None:
    command = [sys.executable, "docs/gallery.py", TASK, "--out", str(tmp_path)]
    result = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    own = tmp_path / FOLDER / TASK
    drawn = {file.stem: file for file in own.glob("*.jpg")}
    stages = {f"stage_{number}" for number in range(1, catalog.get(TASK).max_stage + 1)}
    assert set(drawn) == {OVERVIEW, *POLICY_CAMERAS} | stages
    for file in drawn.values():
        with Image.open(file) as image:
            assert np.asarray(image.convert("L")).std() > BLANK, file.name
    kept = json.loads((own / DRAWN).read_text(encoding="utf-8"))
    assert kept == sources(catalog.get(TASK), kept["reached"])
