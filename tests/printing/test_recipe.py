"""Recipes: what is lifted weighs what it must, estimates follow the volume, nothing is left out."""

from __future__ import annotations

import json

import pytest

from duobench.core.files import decode, encode
from duobench.printing import Recipe, details as known, recipe_of
from duobench.printing.recipe import (
    LAYER,
    MATERIAL_PER_SECOND,
    RECIPE_SCHEMA,
    SPARSE,
    WASTE,
    extruded,
    recipe_page,
)
from duobench.tasks import catalog
from tests.printing.printed import JOBS, PARTS, TASKS, belongs, job, part

jobs = pytest.mark.parametrize("name", JOBS)


@jobs
def test_a_recipe_is_read_as_it_was_written(name: str) -> None:
    recipe = recipe_of(job(name))
    text = encode(recipe, RECIPE_SCHEMA)
    assert encode(decode(text, Recipe, RECIPE_SCHEMA), RECIPE_SCHEMA) == text
    assert json.loads(text)["nozzle_mm"] == 0.4


@jobs
def test_what_is_lifted_is_solid_and_has_a_target_mass(name: str) -> None:
    recipe = recipe_of(job(name))
    for each in recipe.parts:
        assert (each.infill_percent == 100) is (each.mass_g is not None)
        assert each.infill_pattern == ("rectilinear" if each.mass_g is not None else "grid")
        if each.mass_g is not None:
            least, target, most = each.mass_g
            assert target == pytest.approx(1.24 * each.volume_cm3, rel=0.01, abs=0.06)
            assert (least, most) == pytest.approx((0.95 * target, 1.05 * target), abs=0.1)
    for each in recipe.objects:
        parts = [p for p in recipe.parts if belongs(p.body, each.body)]
        assert {p.infill_percent for p in parts} == {15 if each.mass_g is None else 100}
        if each.mass_g is not None:
            together = sum(p.count * p.mass_g[1] for p in parts if p.mass_g)
            assert together == pytest.approx(each.mass_g[1], rel=0.01, abs=0.1)


def test_what_stands_still_is_what_may_be_lighter() -> None:
    objects = [(name, each) for name in TASKS for each in recipe_of(job(name)).objects]
    light = {f"{name}/{each.body}" for name, each in objects if each.mass_g is None}
    still = set()
    for name in TASKS:
        bought = {prop for item in job(name).bought for prop in item.props}
        fixed = {prop.name for prop in catalog.get(name).props if prop.fixed}
        still |= {f"{name}/{prop}" for prop in fixed - bought}
    details = known.details().items()
    assert light == still == {f"{name}/{body}" for name, task in details for body in task.fixing}
    assert "hinge_chest/chest/lid" not in light


@pytest.mark.parametrize(("name", "of"), PARTS)
def test_estimates_follow_the_volume(name: str, of: str) -> None:
    one = part(name, of)
    (written,) = (each for each in recipe_of(job(name)).parts if each.name == of)
    laid_down = extruded(one)
    if one.is_solid:
        assert laid_down == one.volume
    else:
        assert SPARSE * one.volume < laid_down <= one.volume
    grams = 1000 * one.density * WASTE * laid_down * one.count
    assert written.filament_g == pytest.approx(grams, abs=0.06)
    seconds = WASTE * laid_down * one.count / MATERIAL_PER_SECOND * LAYER / written.layer_mm
    assert written.hours == pytest.approx(seconds / 3600, abs=0.006)


def test_everything_that_is_known_is_about_a_part() -> None:
    keys = {
        "/".join(filter(None, (name, one.body.replace("board_0", "board"), one.piece)))
        for name in TASKS
        for one in job(name).parts
    }
    supports = {f"{name}/{key}" for name, task in known.details().items() for key in task.supports}
    for table in (known.DIMENSIONS, known.CHANGES, supports, known.FINE):
        assert set(table) <= keys
    assert set(known.details()) <= set(TASKS)


def test_chamfers_have_finer_layers() -> None:
    layers = {name: {p.layer_mm for p in recipe_of(job(name)).parts} for name in TASKS}
    assert layers["join_blocks"] == layers["transfer_reorient"] == {0.12}
    assert layers["bin_sort"] == {0.2}


def test_screws_of_the_chest_are_on_its_list() -> None:
    bought = {item.name: item.count for item in recipe_of(job("hinge_chest")).bought}
    assert bought == {"M3 × 20 mm screw": 2, "M3 nut": 2}


def test_colours_change_where_the_simulated_ones_do() -> None:
    (floor,) = (p for p in recipe_of(job("ball_maze")).parts if p.name == "board_4-floor")
    assert floor.colour_changes == [(4.0, "#29578F")]
    (bowl,) = (p for p in recipe_of(job("bin_sort")).parts if p.name == "black_bowl")
    assert bowl.colour_changes == [(25.0, "#B8B8BA")]


def test_every_maze_says_where_it_starts_and_ends() -> None:
    notes = [note for note in recipe_of(job("ball_maze")).notes if note.startswith("Maze ")]
    assert len(notes) == 10
    corners = [note.split("it starts ")[1] for note in notes]
    assert all("goal is" in corner for corner in corners)
    # Start and goal of the first one are at opposite ends of its upper side.
    assert corners[0] == "back left, its goal is back right."


@jobs
def test_a_page_has_every_part_size_and_purchase_and_says_that_nothing_was_tried(
    name: str,
) -> None:
    recipe = recipe_of(job(name))
    page = recipe_page(recipe)
    assert "Nothing of this was printed by us so far" in page
    for each in recipe.parts:
        assert f"| `{each.name}` | {each.count} |" in page
        for size in each.dimensions:
            assert f"| `{each.name}` | {size.what} | {size.mm:g} | {size.tolerance_mm:g} |" in page
    for item in recipe.bought:
        assert item.name in page
    for line in page.splitlines():
        assert not line.startswith("|") or line.endswith("|")
