"""Pages with images and scenes: what is drawn is all there, shown, small, and not old."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import gallery
import gallery_page
import gallery_shots
import gallery_sources
import looks
import numpy as np
import prints
import prints_page
import pytest
import replays
from PIL import Image, ImageSequence

from duobench.core.errors import RenderingError
from duobench.printing.details import details
from duobench.tasks import catalog
from duobench.world.looks.catalog import LOOKS, look
from duobench.world.looks.look import CLASSIC
from duobench.world.robot.cameras import OVERVIEW, POLICY_CAMERAS
from duobench.world.scene.compose import compose
from duobench.world.sim.rendering import describe
from tests.docs.markdown import DOCS, ROOT, blocks, links, page_of, run, run_python, text_of
from tests.golden import episodes

DRAWER = DOCS / "tasks"
BLANK = 5.0
"""Standard deviation of the brightness of an image on which there is little to see."""
MOVED = 64
"""Of 255, by which some pixel of a film differs from the image before, as arms move."""
TASKS = pytest.mark.parametrize("name", catalog.names())


def read(file: Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else None


def contrast(file: Path) -> float:
    with Image.open(file) as image:
        return float(np.asarray(image.convert("L"), dtype=float).std())


# --- all of them ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Drawn:
    """A page and its images."""

    page: str
    folder: str
    max_bytes: int


PAGES = (
    Drawn(gallery_page.PAGE, gallery_shots.FOLDER, 3_600_000),
    Drawn("looks.md", looks.FOLDER, 1_500_000),
    Drawn(prints_page.PAGE, prints_page.FOLDER, 1_500_000),
)
EACH = pytest.mark.parametrize("drawn", PAGES, ids=lambda drawn: drawn.folder)


@EACH
def test_every_image_is_linked_and_every_link_leads_to_one(drawn: Drawn) -> None:
    page = DRAWER / drawn.page
    images = set((DRAWER / drawn.folder).rglob("*.jpg"))
    linked = {page.parent / link for link in links(page) if link.startswith(f"{drawn.folder}/")}
    shown = set(re.findall(r"!\[[^]]*\]\(([^)]+)\)", text_of(page)))
    assert shown
    assert linked == images
    assert {DRAWER / target for target in shown} <= images


@EACH
def test_the_images_are_small_together(drawn: Drawn) -> None:
    files = [file for file in (DRAWER / drawn.folder).rglob("*") if file.is_file()]
    if drawn.folder == gallery_shots.FOLDER:
        files.append(DRAWER / gallery.COVER)
    assert sum(file.stat().st_size for file in files) < drawn.max_bytes


# --- the gallery ---------------------------------------------------------------------------------

TASK = "carry_pot"


@TASKS
def test_the_images_are_not_old(name: str) -> None:
    task, seed = catalog.get(name), str(gallery_shots.shot(name).seed)
    reached = episodes.read()["tasks"][name][seed]["stages"]
    kept = read(DRAWER / gallery_shots.FOLDER / name / gallery.DRAWN)
    assert kept == gallery_sources.sources(task, reached), "run: make docs"


def test_what_is_drawn_tells_one_model_from_another() -> None:
    task, digest = catalog.get(TASK), gallery_sources.model_digest
    painted = replace(task.props[0].solid, rgba=(1.0, 0.0, 0.0, 1.0))
    others = [
        replace(task, props=(replace(task.props[0], solid=painted), *task.props[1:])),
        replace(task, overview=replace(task.overview, fovy_deg=30.0)),
        catalog.get("transfer_cube"),
    ]
    assert digest(task) == digest(replace(task, title="Another title"))
    assert len({digest(one) for one in (task, *others)}) == 1 + len(others)


def test_stages_are_drawn_a_moment_later_but_before_the_next() -> None:
    reached = [(50, 1), (60, 2), (200, 4), (210, 5)]
    late = (60 + gallery_shots.LATER, 2)
    assert list(gallery.moments(reached)) == [(55, 1), late, (205, 4), (210, 5)]
    assert list(gallery.moments([(7, 1)])) == [(7, 1)]


def test_shots_are_of_tasks_and_from_inside_the_room() -> None:
    assert set(gallery_shots.SHOTS) <= set(catalog.names())
    for plan in gallery_shots.SHOTS.values():
        for view in {plan.view, plan.last or plan.view}:
            compose((), view)


@pytest.mark.long
@pytest.mark.slow
def test_the_script_draws_a_task(tmp_path: Path) -> None:
    try:
        describe(look(gallery_shots.LOOK).renderer)
    except RenderingError as error:
        pytest.skip(str(error))
    run([sys.executable, "docs/gallery.py", TASK, "--out", str(tmp_path)], ROOT)
    own = tmp_path / gallery_shots.FOLDER / TASK
    drawn = {file.stem: file for file in own.glob("*.jpg")}
    stages = {f"stage_{number}" for number in range(1, catalog.get(TASK).max_stage + 1)}
    assert set(drawn) == {OVERVIEW, *POLICY_CAMERAS} | stages
    assert [name for name, file in drawn.items() if contrast(file) <= BLANK] == []
    with Image.open(own / gallery_shots.FILM) as film:
        moments = [
            np.asarray(one.convert("RGB"), dtype=int) for one in ImageSequence.Iterator(film)
        ]
    assert [one.shape[:2] for one in moments] == [gallery_shots.FILM_SIZE] * len(moments)
    assert len(moments) == gallery_shots.FILM_FRAMES
    assert all(abs(one - other).max() > MOVED for one, other in pairwise(moments[:-1]))
    kept = read(own / gallery.DRAWN)
    assert kept == gallery_sources.sources(catalog.get(TASK), kept["reached"])


# --- looks ---------------------------------------------------------------------------------------


def test_it_names_every_look_and_every_task() -> None:
    text = text_of(page_of("looks"))
    assert re.findall(r"(?m)^\| `([a-z_]+)` \|", text) == list(LOOKS)
    classic = {name for name, each in LOOKS.items() if each.renderer == CLASSIC}
    assert classic <= set(looks.NAMES)
    assert set(LOOKS) - classic >= {looks.PAIR[1]}
    for name in looks.NAMES:
        look(name)
    titles = re.findall(r"(?m)^### (.+)$", text)
    assert titles == [catalog.get(name).title for name in catalog.names()]


def test_the_images_of_looks_are_not_old() -> None:
    assert read(DRAWER / looks.FOLDER / looks.DRAWN) == looks.sources(), "run: make docs"


@pytest.mark.parametrize("code", blocks(page_of("looks"), "python"))
def test_the_code_runs(code: str) -> None:
    run_python(code, ROOT)


@pytest.mark.slow
def test_the_script_draws_the_looks_of_a_task(tmp_path: Path) -> None:
    run([sys.executable, "docs/looks.py", "transfer_cube", "--out", str(tmp_path)], ROOT)
    (file,) = (tmp_path / looks.FOLDER).iterdir()
    assert contrast(file) > 4 * BLANK


# --- printed parts -------------------------------------------------------------------------------

JOBS, APART = prints_page.JOBS, prints.APART
PICTURES = {f"{name}.jpg" for name in JOBS if prints_page.job(name).parts}
PICTURES |= set(map(prints_page.together_file, APART))


@pytest.mark.parametrize("name", sorted(PICTURES))
def test_there_is_something_to_see(name: str) -> None:
    file = DRAWER / prints_page.FOLDER / name
    with Image.open(file) as image:
        assert image.size == prints.SIZE[::-1]
    assert contrast(file) > BLANK


def test_pictures_are_not_older_than_the_parts() -> None:
    digests = {name: prints_page.digest(prints_page.job(name)) for name in JOBS}
    assert read(DRAWER / prints_page.FOLDER / prints_page.DRAWN) == digests, "run: make docs"


def test_whatever_is_put_together_is_shown_so() -> None:
    assert {name for name, one in details().items() if one.assembly} <= set(APART)
    assert {name: len(list(prints.together(name))) for name in APART} == {
        "hinge_chest": 6,  # box, lid, two screws with heads
        "ball_maze": 7,  # frame, floor, four grips, ball
        "join_blocks": 3,
        "transfer_gate": 3,
        "transfer_reorient": 2,
    }


# --- tasks in 3D ---------------------------------------------------------------------------------


def episode(text: str) -> dict[str, Any]:
    found = re.search(r'class="episodes-data">(.*?)</script>', text)
    assert found
    (shown,) = json.loads(found[1])
    return shown


def written(name: str) -> str:
    return text_of(replays.FOLDER / f"{name}.html")


def test_there_is_a_page_for_each_task_and_no_other() -> None:
    found = sorted(path.stem for path in Path(replays.FOLDER).glob("*"))
    assert found == sorted(catalog.names())


@TASKS
def test_the_expert_solves_it_there(name: str) -> None:
    shown, task = episode(written(name)), catalog.get(name)
    assert shown["stages"] == [stage.name for stage in task.stages], "run: make docs"
    assert [stage for _, stage in shown["stage_changes"]][-1] == task.max_stage
    assert shown["instruction"]


def test_a_page_shows_what_its_expert_does_now() -> None:
    assert episode(replays.page("bin_sort")) == episode(written("bin_sort")), "run: make docs"
