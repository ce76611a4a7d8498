"""The layout sheet: outlines in their true size, where the layout has the objects."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import UnknownNameError
from duobench.core.spatial import SE3
from duobench.core.types import Array
from duobench.printing import Paper, layout_sheet, neutral_layout, outlines_of
from duobench.printing.jig import LINE
from duobench.printing.sheet import marks_of, tile_size
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.world.objects import Prop, bowl, gate
from duobench.world.objects.maze_board import EDGE
from duobench.world.sim.layout import Layout
from tests.pdfs import Read, read_pdf

CONTACT_LINE, RULER_LINE = 0.4, 0.3
BIN_SORT = catalog.get("bin_sort")


def prop_of(task: str, name: str) -> Prop:
    (found,) = (prop for prop in catalog.get(task).props if prop.name == name)
    return found


def area(polygon: Array) -> float:
    x, y = polygon.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def perimeter(polygon: Array) -> float:
    return float(np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum())


def sheets(task: Task, layout: Layout, *more: Any) -> list[Read]:
    return read_pdf(layout_sheet(task, layout, *more))


def test_the_outline_of_a_cube_is_its_square() -> None:
    (outline,) = outlines_of(prop_of("bin_sort", "white_cube"))
    assert outline.shape == (4, 2)
    assert np.abs(outline) == pytest.approx(np.full((4, 2), 0.016))
    assert area(outline) == pytest.approx(0.032**2)


def test_a_bowl_is_round_and_has_no_hole() -> None:
    (outline,) = outlines_of(prop_of("bin_sort", "white_bowl"))
    assert np.hypot(*outline.T) == pytest.approx(np.full(len(outline), bowl.RADIUS))


def test_what_lies_on_the_table_may_be_less_than_what_is_seen() -> None:
    (seen,) = outlines_of(prop_of("transfer_gate", "gate"))
    (contact,) = outlines_of(prop_of("transfer_gate", "gate"), below=0.002)
    assert np.ptp(contact, axis=0) == pytest.approx(gate.BASE[:2])
    assert np.ptp(seen, axis=0)[0] == pytest.approx(2 * (gate.RING_RADIUS + gate.RING_THICKNESS))


def test_parts_belong_to_the_outline() -> None:
    (chest,) = outlines_of(prop_of("hinge_chest", "chest"))
    assert chest[:, 0].min() < -0.1  # the lip of the lid, in front of the box
    left = outlines_of(prop_of("carry_pot", "pot"))
    assert np.ptp(left[0], axis=0)[1] > 0.3  # both handles


def test_outlines_are_those_of_the_chosen_variant() -> None:
    board = prop_of("ball_maze", "board")
    (first,) = outlines_of(board)
    (other,) = outlines_of(board, {"board": "7"})
    assert area(first) == pytest.approx(area(other))
    assert area(first) > EDGE**2
    with pytest.raises(UnknownNameError, match="Unknown variant of board"):
        outlines_of(board, {})


@pytest.mark.parametrize("name", catalog.names())
def test_the_neutral_layout_has_everything_where_it_may_be(name: str) -> None:
    task = catalog.get(name)
    layout = neutral_layout(task)
    assert {prop.name for prop in task.props} <= layout.poses.keys()
    for prop, place in task.placements.items():
        x, y, z = layout.poses[prop].translation
        assert place.x.low <= x <= place.x.high
        assert place.y.low <= y <= place.y.high
        assert z == place.z


def turned(task: Task) -> Layout:
    """A layout in which everything is turned, and little lies on the edge of a sheet."""
    layout = neutral_layout(task)
    poses = {name: pose @ SE3.at(0.013, 0.021, yaw=0.4) for name, pose in layout.poses.items()}
    return replace(layout, poses=poses)


@pytest.mark.slow
@pytest.mark.parametrize("paper", Paper)
@pytest.mark.parametrize("name", catalog.names())
def test_all_tiles_together_show_every_outline_once(name: str, paper: Paper) -> None:
    task = catalog.get(name)
    layout = turned(task)
    _, *tiles = sheets(task, layout, "a test", paper)
    drawn = np.vstack([tile.lines(CONTACT_LINE) for tile in tiles])
    length = np.linalg.norm(drawn[:, 0] - drawn[:, 1], axis=1).sum()
    on_table = [prop for prop in task.props if prop.name in task.placements and prop.name != "ball"]
    expected = sum(
        1000 * perimeter(outline)
        for prop in on_table
        for outline in outlines_of(prop, layout.variants, below=0.002)
    )
    assert length == pytest.approx(expected, rel=1e-3)
    width, height = paper.size
    assert (drawn >= 0).all()
    assert (drawn[:, :, 0] <= width).all()
    assert (drawn[:, :, 1] <= height).all()


@pytest.mark.parametrize("paper", Paper)
def test_an_outline_is_in_its_place_and_has_its_true_size(paper: Paper) -> None:
    layout = turned(BIN_SORT)
    cube, half = layout.poses["white_cube"], 0.016
    corners = [(x, y, 0.0) for x in (-half, half) for y in (-half, half)]
    expected = [1000 * cube.apply(corner)[:2] for corner in corners]
    width, height = tile_size(paper)
    left, bottom = (paper.size[0] - width) / 2, paper.size[1] - 12 - height
    found = []
    for tile in sheets(BIN_SORT, layout, "a test", paper)[1:]:
        corner = re.search(r"lower left corner: x (-?\d+), y (-?\d+) mm", "\n".join(tile.texts))
        assert corner is not None
        for across, up in tile.lines(CONTACT_LINE).reshape(-1, 2):
            found.append((int(corner[1]) + up - bottom, int(corner[2]) - (across - left)))
    for corner in expected:
        assert min(math.dist(corner, other) for other in found) < 0.15, (expected, found)


def corners(pages: list[Read]) -> list[tuple[int, int]]:
    """Lower left corners of tiles in mm: x and y."""
    found = []
    for tile in pages[1:]:
        corner = re.search(r"lower left corner: x (-?\d+), y (-?\d+) mm", "\n".join(tile.texts))
        assert corner is not None
        found.append((int(corner[1]), int(corner[2])))
    return found


@pytest.mark.long
@pytest.mark.parametrize("paper", Paper)
@pytest.mark.parametrize("name", catalog.names())
def test_sheets_begin_at_the_jig_and_each_lies_beside_an_earlier_one(
    name: str, paper: Paper
) -> None:
    task = catalog.get(name)
    width, height = tile_size(paper)
    for layout in (neutral_layout(task), turned(task)):
        pages = sheets(task, layout, "a test", paper)
        first, *others = corners(pages)
        assert first == (1000 * LINE, width / 2)
        placed = [first]
        for x, y in others:
            beside = ((abs(x - a), abs(y - b)) for a, b in placed)
            assert any(apart in ((height, 0), (0, width)) for apart in beside), (x, y, placed)
            placed.append((x, y))
        assert len(set(placed)) == len(placed)
        marked = ["this edge against the jig" in " ".join(page.texts) for page in pages]
        assert marked == [False, True, *(False for _ in others)]


def test_what_is_nearer_than_the_jig_has_sheets_as_well() -> None:
    near = {name: SE3.at(0.17, 0.3) for name in neutral_layout(BIN_SORT).poses}
    pages = sheets(BIN_SORT, Layout(poses=near))
    assert corners(pages) == [(240, 90), (240, 270), (240, 450), (-20, 270), (-20, 450)]


def test_rulers_are_a_hundred_millimetres_long() -> None:
    for tile in sheets(BIN_SORT, turned(BIN_SORT))[1:]:
        ruled = tile.lines(RULER_LINE)
        lengths = np.linalg.norm(ruled[:, 0] - ruled[:, 1], axis=1)
        rulers = ruled[np.abs(lengths - 100) < 1e-3]
        assert len(rulers) == 2
        ways = rulers[:, 1] - rulers[:, 0]
        assert abs(ways[0] @ ways[1]) < 1e-3


def test_places_are_written_in_millimetres_and_degrees() -> None:
    here = SE3.at(0.5231, -0.2014, 0.016, yaw=0.5)
    layout = Layout(poses={**neutral_layout(BIN_SORT).poses, "white_cube": here})
    text = "\n".join(sheets(BIN_SORT, layout, "seed 4 (a test)")[0].texts)
    assert "white_cube: x 523.1, y -201.4 mm, yaw 28.6°" in text
    assert "seed 4 (a test)" in text


def test_a_maze_is_named_and_its_ball_is_placed() -> None:
    task = catalog.get("ball_maze")
    layout = task.arranged(replace(neutral_layout(task), variants={"board": "9"}))
    text = "\n".join(sheets(task, layout)[0].texts)
    assert "board 9: x 500.0" in text
    assert "In or on another object: ball, x" in text


@pytest.mark.parametrize("name", catalog.names())
def test_what_stands_in_or_on_something_else_has_no_outline_of_its_own(name: str) -> None:
    task = catalog.get(name)
    marks = list(marks_of(task, neutral_layout(task)))
    assert [mark.name.partition(" ")[0] for mark in marks] == [prop.name for prop in task.props]
    for mark in marks:
        lies_in = mark.name.startswith(("marble", "ball"))
        assert (mark.on_table, bool(mark.contact), bool(mark.seen)) == (not lies_in,) * 3


def test_an_incomplete_layout_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="object of the layout 'white_cube'"):
        layout_sheet(BIN_SORT, Layout(poses={}))
