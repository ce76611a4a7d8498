"""What docs/real_setup.md and docs/real_cameras.md show works as it stands there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.cli.program import GROUPS
from duobench.hardware.calibration import places
from duobench.hardware.calibration.board import RULER_MM
from duobench.hardware.calibration.views import ViewFolder
from duobench.hardware.doctor.examine import (
    LARGEST_SHIFT_PX,
    LEAST_RATE,
    LEAST_SUCCESS,
    LONGEST_ANSWER_S,
)
from duobench.hardware.drivers import frames, robotiq
from duobench.hardware.rig import CameraDriver, Rig
from duobench.sheets import Paper
from tests.docs.markdown import DOCS, blocks, table, text_of

SETUP, CAMERAS = DOCS / "real_setup.md", DOCS / "real_cameras.md"
COMMANDS = [
    shlex.split(line)
    for page in (SETUP, CAMERAS)
    for line in text_of(page).splitlines()
    if line.startswith("duobench ")
]


@pytest.mark.parametrize("page", [SETUP, CAMERAS])
def test_pages_say_that_nothing_was_tried(page: Path) -> None:
    assert re.search(r"\*\*Not yet tried on an? (arm|camera)", text_of(page))


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_command_is_one(words: list[str]) -> None:
    group = " ".join(words[1:3]) if words[2] == "calibrate" else words[1]
    verb = words[len(group.split()) + 1]
    assert verb in GROUPS[group]
    names = GROUPS[group][verb].__annotations__
    options = [word[2:].replace("-", "_") for word in words if word.startswith("--")]
    assert set(options) <= set(names)


def test_commands_without_hardware_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runnable = [words for words in COMMANDS if "simulated" in words or "board" in words]
    assert len(runnable) == 2
    for words in runnable:
        main(words[1:])
    assert (tmp_path / "board.pdf").exists()
    assert (tmp_path / "runs" / "simulated" / "doctor.json").exists()


def test_the_rig_of_the_page_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(SETUP, "python")
    exec(code, {})
    rig = Rig.read(tmp_path / "rig.json")
    assert rig.cameras["head"].is_side_by_side
    assert not rig.is_computed


def test_views_of_the_page_are_some(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(CAMERAS, "python")
    exec(code, {})
    assert len(ViewFolder(tmp_path / "wrist_left", "left_wrist")) == 1


def test_drivers_are_those_of_the_table() -> None:
    rows = table(CAMERAS, "driver in the rig's file")
    assert {row["driver in the rig's file"] for row in rows} == {str(each) for each in CameraDriver}


def test_numbers_are_those_of_the_code() -> None:
    setup, cameras = (" ".join(text_of(page).split()) for page in (SETUP, CAMERAS))
    assert f"No answer for {robotiq.SILENT_S} s is a fault" in setup
    assert f"No image for {frames.STALE_S} s is a fault" in cameras
    assert f"less than {LEAST_SUCCESS:.0%}".replace("%", " %") in setup
    assert f"at less than {LEAST_RATE:.0%}".replace("%", " %") in setup
    assert f"more than {LARGEST_SHIFT_PX:g} px" in setup
    assert f"answers take {1000 * LONGEST_ANSWER_S:.0f} ms" in setup
    assert f"fewer than {places.FEWEST_VIEWS} show" in cameras
    assert f"by more than {places.LARGEST_SCALE_ERROR:.0%}".replace("%", " %") in cameras
    assert f"over {1000 * places.NOTED_M:.0f} mm or {places.NOTED_DEG:.0f} degrees" in cameras
    assert f"from {1000 * places.REFUSED_M:.0f} mm or {places.REFUSED_DEG:.0f} degrees" in cameras
    assert RULER_MM[Paper.A4] == 200.0
