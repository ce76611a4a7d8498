"""The page on printing has the objects of the benchmark, as they are."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from tables import printed

from duobench.cli import main
from duobench.fabrication import coupon as coupons
from duobench.fabrication import recipe as recipes
from duobench.fabrication.threemf import BED_STEP
from duobench.objects import chest, hexagon_peg, joint_blocks, shapes
from duobench.tasks import catalog
from tests.docs.markdown import DOCS, blocks, table, text_of

PAGE = DOCS / "printing.md"
TASKS = [task for task in map(catalog.get, catalog.names()) if task.printable]


def test_all_variants_of_an_object_print_as_the_table_says() -> None:
    for task in TASKS:
        for prop in task.props:
            found = [printed(task.id, prop, value) for value in prop.variants]
            assert all(one == found[0] for one in found)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("edge of the printer", shapes.PRINTER),
        ("corner of the bed that stays free, width", shapes.KEPT_FREE[0]),
        ("corner of the bed that stays free, depth", shapes.KEPT_FREE[1]),
        ("thinnest wall", shapes.THINNEST_WALL),
        ("play of a glued joint", shapes.JOINT_PLAY),
        ("overlap", shapes.OVERLAP),
        ("play of a square peg", joint_blocks.CLEARANCE),
        ("play of the hexagonal peg", hexagon_peg.CLEARANCE),
        ("hole in a lug", 2 * chest.HOLE_RADIUS),
        ("hole in the barrel", 2 * chest.THREAD_RADIUS),
        ("play between lid and box", chest.GAP),
        ("play between a post and the open lid", chest.POST_PLAY),
    ],
)
def test_the_page_names_the_sizes(name: str, value: float) -> None:
    (line,) = (line for line in table(PAGE, "size") if line["size"] == name)
    assert line["mm"] == f"{1000 * value:g}"


def test_the_page_says_how_dense_a_print_is() -> None:
    assert "1240 kg/m³" in text_of(PAGE)


def test_the_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = blocks(PAGE, "python")
    exec(example, {})
    assert len(capsys.readouterr().out.splitlines()) == 3


def test_the_commands_write_what_the_table_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (commands,) = blocks(PAGE, "sh")
    for line in commands.splitlines():
        main(shlex.split(line)[1:])
    listed = [row["file"] for row in table(PAGE, "file")]
    for file in listed:
        named = file.replace("TASK", "transfer_gate").replace("PART", "gate-ring")
        assert (tmp_path / "prints" / "gate" / named).exists(), file
    written = {path.suffix for path in (tmp_path / "prints" / "gate").rglob("*") if path.is_file()}
    assert written == {Path(file).suffix for file in listed if "." in file}
    boards = {path.name for path in (tmp_path / "prints" / "mazes" / "ball_maze").glob("board*")}
    assert {name.partition("-")[0] for name in boards} == {"board_0", "board_7"}


def test_the_page_says_how_filament_and_hours_are_estimated() -> None:
    text = " ".join(text_of(PAGE).split())
    for words in (
        f"{1e9 * recipes.MATERIAL_PER_SECOND:.0f} mm³ a second",
        f"{100 * (recipes.WASTE - 1):.0f} % is added",
        f"{100 * recipes.SPARSE:.0f} % of the rest",
        f"± {100 * recipes.TOLERANCE:.0f} %",
        f"{1000 * BED_STEP:.1f} mm apart",
        f"{1000 * coupons.HEXAGON_PLAYS[0]:g} to {1000 * coupons.HEXAGON_PLAYS[-1]:g} mm of play",
        f"{1000 * coupons.SQUARE_PLAYS[0]:g} to {1000 * coupons.SQUARE_PLAYS[-1]:g} mm;",
    ):
        assert words in text
    assert coupons.HEXAGON_PLAYS[2] == hexagon_peg.CLEARANCE
    assert coupons.SQUARE_PLAYS[2] == joint_blocks.CLEARANCE
