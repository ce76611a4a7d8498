"""`duobench real rig check`: what will hold, or what is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from duobench.real.rig import Rig
from tests.cli.conftest import Told, refusal
from tests.real.simulated import GRIPPER
from tests.real.test_rig_file import RIGHT, changed


def lab(folder: Path, document: Any) -> Path:
    path = folder / "rig.json"
    path.write_text(json.dumps(document))
    return path


def test_what_will_hold_is_said(tmp_path: Path, told: Told) -> None:
    path = lab(tmp_path, RIGHT)
    said = told("real", "rig", "check", path)
    words = " ".join(said.split())
    for each in (
        Rig.read(path).hash,
        "Left arm: franky at 172.16.0.2",
        "Right arm: franky at 172.16.1.2",
        "at most rad/s 0.655 0.655 0.655 0.655 1.315 1.045 1.315",
        "at most deg/s 38 38 38 38 75 60 75",
        "way home, deg/s 15 15 15 15 30 24 30",
        "stops at N·m 20 20 20 20 8 8 8",
        "stiffness, N·m/rad 600 600 600 600 250 150 50",
        "acceleration at most 4 rad/s², tool at most 0.25 m/s; stops at 30 N and 8 N·m",
        "Left gripper: robotiq at /dev/left, 40 N, 53 mm/s; open at 3, closed at 228",
        "Camera head: uvc at /dev/zed, 1280 x 720 pixels, 30 Hz; calibrated",
        "Camera left_wrist: realsense at 1, 1280 x 720 pixels, 30 Hz; not calibrated",
        "Workspace of both tools: x 0.1 to 0.8, y -0.5 to 0.6, z 0 to 0.8 m",
        "Obstacle mast: 0.1 x 0.1 x 1 m around 0, 0.9, 0.5",
    ):
        assert each in words
    assert "Note:" not in words


@pytest.mark.parametrize(
    ("right", "is_noted"),
    [("172.16.0.3", True), ("127.0.0.2", False), ("right-arm.local", False)],
)
def test_what_a_lab_should_not_do_is_noted(
    right: str, is_noted: bool, tmp_path: Path, told: Told
) -> None:
    document = changed("arms.right.address", right)
    del document["cameras"]["head"]
    said = told("real", "rig", "check", lab(tmp_path, document))
    assert ("both arms are in one subnet" in said) == is_noted
    assert "no head camera" in said


def test_the_rig_without_a_file_is_described(told: Told) -> None:
    said = told("real", "rig", "check", "rehearsal")
    assert "Left arm: rehearsal" in said
    assert "tool at most 2 m/s" in said


def test_nothing_is_measured_where_a_hand_knows_its_ends(tmp_path: Path, told: Told) -> None:
    document = changed("gripper", "franka_hand")
    for side, address in (("left", "172.16.0.2"), ("right", "172.16.1.2")):
        document["grippers"][side] = {"driver": "franka_hand", "port": address}
    path = lab(tmp_path, document)
    before = path.read_bytes()
    said = " ".join(told("real", "rig", "check", path).split())
    assert "Left gripper: franka_hand at 172.16.0.2, 16 N, 33 mm/s Right" in said
    said = told("real", "calibrate", "gripper", "left", "--rig", path)
    assert "a Franka Hand says its gap in metres" in said
    assert path.read_bytes() == before


def test_what_a_rig_leaves_out_is_said(tmp_path: Path, told: Told) -> None:
    document = changed("workspace", None)
    del document["cameras"], document["obstacles"]
    said = told("real", "rig", "check", lab(tmp_path, document))
    assert ("No cameras." in said, "Workspace: none" in said) == (True, True)


def test_a_way_home_is_never_faster_than_everything_else(tmp_path: Path, told: Told) -> None:
    said = told("real", "rig", "check", lab(tmp_path, changed("arms.left.speed_fraction", 0.05)))
    assert " ".join(said.split()).count("way home, deg/s 8 8 8 8 15 12 15") == 1


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        ("arms.left.speed_fracton", 0.05, "Did you mean 'speed_fraction'"),
        ("obstacles.mast.centre", [0.5, 0.2, 0.5], "cannot be at home beside"),
        ("workspace.low", [0.6, -0.5, 0.0], "both tools at home between them"),
        ("arms.left.driver", "no_such_lab:Arm", "There is no module named 'no_such_lab'"),
        ("grippers.left.driver", GRIPPER, "SimulatedGripper beside a real arm"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path: Path, place: str, value: Any, said: str) -> None:
    message = refusal("real", "rig", "check", lab(tmp_path, changed(place, value)))
    assert said in message
    assert "\n" not in message.strip()


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    assert "There is no file" in refusal("real", "rig", "check", tmp_path / "rig.json")
    assert "Did you mean `duobench real rig check x.json`?" in refusal("real", "rig", "x.json")
