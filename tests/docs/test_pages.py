"""The pages of docs/ say what the code says: tables, names, numbers and links."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import site_outline
import site_tasks
from tables import TABLES, written

import duobench
from duobench.core.randomness import SUITE_VERSION
from duobench.core.types import CONTROL_HZ
from duobench.data.schema import SCHEMA
from duobench.envs.duo_env import base_of
from duobench.envs.registration import VERSION
from duobench.policy import PolicyMetadata
from duobench.results.records import RECORD_SCHEMA, Record
from duobench.results.report import SUMMARY_SCHEMA
from duobench.results.run import RUN_SCHEMA, TimeLimits
from duobench.tasks import catalog
from duobench.world.robot.cameras import POLICY_CAMERAS
from duobench.world.robot.joints import HOME_JOINTS
from duobench.world.scene.compose import SUBSTEPS
from tests.docs.markdown import DOCS, PAGES, ROOT, blocks, links, page_of, table, tables, text_of

STAGES, FRAMES, EVALUATION, POLICIES = (
    page_of(name) for name in ("stages", "frames", "evaluation", "policies")
)
MAX_BYTES = 8_000_000
CHUNK = 2
TASK = "pour_marbles"  # has variants


def test_the_code_names_pages_that_there_are() -> None:
    """Errors and help do, as "see the page NAME"."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    named = set(re.findall(r"see\s+the\s+page\s+([a-z_]+)", text))
    assert len(named) > 3
    assert named <= {page.stem for page in PAGES}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    assert [link for link in links(page) if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", TABLES, ids=str)
def test_what_follows_from_the_code_is_written_into_pages(page: str) -> None:
    assert written(page) == text_of(page_of(page)), "run: make docs"


def test_every_page_is_linked_from_the_first_one() -> None:
    linked = {(ROOT / link).resolve() for link in links(ROOT / "README.md")}
    assert [page.name for page in DOCS.rglob("*.md") if page.resolve() not in linked] == []


def test_every_page_has_one_place_on_the_site_in_the_drawer_where_it_lies() -> None:
    for drawer in DOCS.iterdir():
        for page in drawer.glob("*.md"):
            assert list(site_outline.pages(drawer.name)).count(page.stem) == 1, page.name


def test_the_folder_stays_small() -> None:
    assert 0 < sum(file.stat().st_size for file in DOCS.rglob("*") if file.is_file()) < MAX_BYTES


# --- stages and info -----------------------------------------------------------------------------


def described(value: Any) -> str:
    """The type of a value of info, in the words of the page."""
    if isinstance(value, np.ndarray):
        (length,) = value.shape
        return f"{value.dtype} array ({'chunk' if length == CHUNK else length},)"
    if isinstance(value, dict) and all(isinstance(key, int) for key in value):
        (kind,) = {type(part).__name__ for part in value.values()}
        return f"dict[int, {kind}]"
    if isinstance(value, tuple):
        (kind,) = {type(part).__name__ for part in value}
        return f"tuple[{kind}]"
    return type(value).__name__


HOME_JOINTS_OPEN = np.concatenate([[*joints, 1.0] for joints in HOME_JOINTS])


def test_the_table_of_info_has_every_key_with_its_type_its_time_and_its_wrapper() -> None:
    """After a reset, a step, and one that held arms ended, as every wrapper adds to it."""
    env: gym.Env = duobench.make(TASK, cameras=False, chunk=CHUNK)
    added: dict[str, str] = {}
    layers = [env]
    while layers[-1] is not env.unwrapped:
        layers.append(layers[-1].env)  # type: ignore[attr-defined]
    for layer in reversed(layers):
        action = np.broadcast_to(HOME_JOINTS_OPEN, layer.action_space.shape)
        at_reset = layer.reset(seed=0)[1]
        at_step = layer.step(action)[-1]
        base_of(env).backend.hold("A test.")
        at_end = layer.step(action)[-1]
        for key in {**at_reset, **at_step, **at_end}:
            added.setdefault(key, type(layer).__name__)
    env.close()
    rows = table(STAGES, "key")
    # The two base classes are one layer.
    assert {row["key"]: row["added by"].replace("DuoEnv", "SimEnv") for row in rows} == added
    for info, times in (
        (at_reset, {"both", "reset"}),
        (at_step, {"both", "step"}),
        (at_end, {"both", "step", "end"}),
    ):
        types = {row["key"]: row["type"] for row in rows if row["at"] in times}
        assert types == {key: described(value) for key, value in info.items()}


# --- frames --------------------------------------------------------------------------------------


def test_observations_have_their_shape_and_type() -> None:
    space = duobench.make("bin_sort").observation_space
    assert isinstance(space, gym.spaces.Dict)
    rows = {row["key"]: row for row in table(FRAMES, "key")}
    assert set(rows) == set(space.spaces)
    for key in ("agent_pos", "tcp_pose"):
        shown = rows[key]["shape"], rows[key]["type"]
        assert shown == (str(space[key].shape), str(space[key].dtype))
    assert {part.dtype for part in space["pixels"].values()} == {np.dtype(rows["pixels"]["type"])}


def test_numbers_of_frames_and_time_are_those_of_the_code() -> None:
    env = duobench.make("bin_sort", cameras=False)
    simulation = env.unwrapped.simulation  # type: ignore[attr-defined]
    env.reset(seed=0)
    flange, tcp = (simulation.site_pose(f"left/{name}") for name in ("flange", "tcp"))
    tools = (flange.inverse() @ tcp).translation
    model = simulation.model
    sizes = {tuple(model.cam_resolution[model.cam(name).id]) for name in POLICY_CAMERAS}
    env.close()
    assert tools == pytest.approx([0.0, 0.0, 0.1493])
    page = text_of(FRAMES).replace("\n", " ")
    ((width, height),) = sizes
    assert 1 / model.opt.timestep == pytest.approx(CONTROL_HZ * SUBSTEPS)
    assert f"{tools[2]:.4f} m beyond the flange" in page
    assert f"The lenses have {width} × {height} pixels" in page


# --- evaluation and policies ---------------------------------------------------------------------


def test_the_table_of_the_record_names_its_fields() -> None:
    named = [row["field"] for row in table(EVALUATION, "field")]
    assert named == [field.name for field in fields(Record)]


def test_versions_are_those_of_the_code() -> None:
    now = {row["version"].rpartition(", ")[2]: row["now"] for row in table(EVALUATION, "version")}
    assert now == {
        "duobench.__version__": duobench.__version__,
        "SUITE_VERSION": SUITE_VERSION,
        "duobench/<task>-v1": str(VERSION),
        "RECORD_SCHEMA": str(RECORD_SCHEMA),
        "RUN_SCHEMA": str(RUN_SCHEMA),
        "SUMMARY_SCHEMA": str(SUMMARY_SCHEMA),
        "data.schema.SCHEMA": str(SCHEMA),
        "PolicyMetadata.version": "the policy's",
    }


def test_defaults_of_the_protocol_are_those_of_the_code() -> None:
    limits = TimeLimits()
    written = [row["default"] for row in table(EVALUATION, "limit")]
    assert written == [f"{limits.act_timeout:g} s", f"{limits.episode_timeout:g} s", "none"]
    values = {row["what"]: row["value"] for row in table(EVALUATION, "what")}
    assert values["control rate"] == f"{CONTROL_HZ:g} Hz"
    per_second = round(CONTROL_HZ * SUBSTEPS)
    assert values["physics steps per control step"] == f"{SUBSTEPS}, of 1/{per_second} s each"
    assert values["cameras"].endswith(", all three by default")
    assert len(PolicyMetadata(name="any").cameras) == 3


def test_the_table_of_metadata_names_its_fields() -> None:
    rows = {
        row["field of PolicyMetadata"]: row for row in table(POLICIES, "field of PolicyMetadata")
    }
    assert list(rows) == [field.name for field in fields(PolicyMetadata)]
    required = {field.name for field in fields(PolicyMetadata) if field.default is MISSING}
    assert {name for name, row in rows.items() if row["default"] == "required"} == required


def test_pages_without_code_have_none() -> None:
    for page in (STAGES, FRAMES):
        assert blocks(page, "python") == blocks(page, "sh") == []


def test_the_page_of_a_task_tells_the_numbers_of_the_page_of_baselines() -> None:
    pages = [
        {row["task"]: row["success (95 %)"] for row in rows if "by seed" in row}
        for rows in tables(page_of("baselines"))
        if "success (95 %)" in rows[0]
    ]
    assert len(pages) == 4  # with 50, with 200, from images, from own successes
    for task in map(catalog.get, catalog.names()):
        cells = list(site_tasks.learned(task))
        found = [page for page in pages if task.id in page]
        for (_, rate, interval, *_), page in zip(cells, found, strict=True):
            told = [float(number) for number in re.findall(r"\d+", page[task.id])]
            exact = [float(rate), *map(float, interval.split("–"))]
            assert told == pytest.approx(exact, abs=0.55)  # rounded, of what is rounded
