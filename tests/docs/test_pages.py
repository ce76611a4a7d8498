"""The pages of docs/ say what the code says, and lead to each other."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import site_outline
import tables

import duobench
from duobench.envs.config import EnvConfig
from duobench.envs.duo_env import base_of
from duobench.evaluation.replay.verification import Verdict
from duobench.policy import PolicyMetadata
from duobench.real.catalog import DRIVERS
from duobench.real.rig import ArmConfig
from duobench.results.records import Record
from duobench.world.robot.mounts import HOME_JOINTS
from tests.docs import markdown
from tests.docs.markdown import DOCS, PAGES, ROOT, blocks, links, page_of, text_of

STAGES, FRAMES, EVALUATION = map(page_of, ("stages", "frames", "evaluation"))
MAX_BYTES = 8_000_000
CHUNK = 2
TASK = "pour_marbles"  # has variants


def fields_of(cls: type) -> set[str]:
    """Names of the fields of a data class."""
    return {field.name for field in fields(cls)}


def test_the_code_names_pages_that_there_are() -> None:
    """Errors and help do, as "see the page NAME"."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    named = set(re.findall(r"see\s+the\s+page\s+([a-z_]+)", text))
    assert len(named) > 3
    assert named <= {page.stem for page in PAGES}


@pytest.mark.parametrize("page", tables.PAGES, ids=lambda page: page.name)
def test_what_follows_from_the_code_is_written_into_pages(page: Path) -> None:
    assert tables.written(page) == text_of(page), "run: make docs"


def test_every_number_has_a_place() -> None:
    found = {name for page in tables.PAGES for _, name, _ in tables.NUMBER.findall(text_of(page))}
    assert found == set(tables.constants.NUMBERS)


def test_a_number_that_would_break_its_page_is_refused(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    for text, said in (
        ("At <!-- number:no such -->1<!-- / --> Hz.", "lacks.*no such"),
        ("At\n<!-- number:floor -->1<!-- / --> m.", "begins with"),
    ):
        page.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=said):
            tables.written(page)
    page.write_text("At <!-- number:floor -->1<!-- / --> m.", encoding="utf-8")
    assert tables.written(page) == "At <!-- number:floor -->-0.8095<!-- / --> m."


FIELDS = (
    ("environments", "option", fields_of(EnvConfig)),
    ("evaluation", "field", fields_of(Record)),
    ("policies", "field of PolicyMetadata", fields_of(PolicyMetadata)),
    ("real_arms", "field of an arm", fields_of(ArmConfig) - {"driver", "address"}),
    ("real_cameras", "driver in the rig's file", set(DRIVERS["cameras"])),
    ("verification", "verdict", set(map(str, Verdict))),
)
"""Pages, and what the table with this first heading explains in words of its own, each of it."""


@pytest.mark.parametrize(("page", "heading", "known"), FIELDS)
def test_a_table_explains_every_field(page: str, heading: str, known: set[str]) -> None:
    named = ",".join(row[heading] for row in markdown.table(page_of(page), heading))
    assert {word.strip() for word in named.split(",")} == known


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
    rows = markdown.table(STAGES, "key")
    # The two base classes are one layer.
    assert {row["key"]: row["added by"].replace("DuoEnv", "SimEnv") for row in rows} == added
    for info, times in (
        (at_reset, {"both", "reset"}),
        (at_step, {"both", "step"}),
        (at_end, {"both", "step", "end"}),
    ):
        types = {row["key"]: row["type"] for row in rows if row["at"] in times}
        assert types == {key: described(value) for key, value in info.items()}


# --- pages of the protocol ------------------------------------------------------------------------


def test_pages_without_code_have_none() -> None:
    for page in (STAGES, FRAMES):
        assert blocks(page, "python") == blocks(page, "sh") == []
