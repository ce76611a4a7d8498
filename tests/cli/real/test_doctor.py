"""`duobench real doctor` and `duobench real calibrate` at the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from duobench.real.calibration import places
from duobench.real.calibration.views import ViewFolder
from duobench.real.rig import CameraConfig, CameraDriver, Rig
from tests.cli.conftest import Told, refusal
from tests.real.lenses import ZED


def lab(folder: Path, device: str) -> Path:
    """A rig whose head camera plays something; its arms are simulated."""
    rig = Rig.simulated()
    head = CameraConfig(driver=CameraDriver.FILE, device=device)
    path = folder / "rig.json"
    replace(rig, name="lab", cameras={"head": head}).write(path)
    return path


def test_a_simulated_rig_is_examined(tmp_path: Path, told: Told) -> None:
    words = ["--rig", "simulated", "--out", tmp_path / "run", "--seconds", "1"]
    assert "left gripper" in told("real", "doctor", *words)
    document = json.loads((tmp_path / "run" / "doctor.json").read_text())
    assert document["is_well"] is True
    assert {check["name"] for check in document["checks"]} >= {"holding", "head camera"}


def test_a_check_that_fails_ends_with_1_and_leaves_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = lab(tmp_path, str(tmp_path / "nothing.mkv"))
    assert refusal("real", "doctor", "--rig", rig, "--out", tmp_path / "run") == "1"
    assert "1 check failed" in capsys.readouterr().out
    document = json.loads((tmp_path / "run" / "doctor.json").read_text())
    assert document["is_well"] is False
    assert "nothing.mkv" in document["checks"][-1]["value"]
    assert document["rig_hash"] == Rig.read(rig).hash


def test_the_board_is_written(tmp_path: Path, told: Told) -> None:
    said = told("real", "calibrate", "board", "--out", tmp_path / "board.pdf", "--paper", "a3")
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")
    assert "300 mm" in " ".join(said.split())


def test_lens_that_is_measured_says_that_the_place_is_to_be_measured_again(
    tmp_path: Path, told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(places, "calibrate_lens", lambda _images, _board: ZED)
    rig = lab(tmp_path, "seen.png")
    ViewFolder(tmp_path / "views", "head").add(np.zeros((90, 160, 3), np.uint8))
    said = told("real", "calibrate", "lens", "head", "--rig", rig, "--views", tmp_path / "views")
    assert "until you measure it (again)" in " ".join(said.split())
