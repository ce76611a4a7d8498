"""`duobench real calibrate` with folders of rendered views, and with a camera that plays a film."""

from __future__ import annotations

import io
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from duobench.cli import main
from duobench.core.spatial import SE3
from duobench.real.calibration.board import Board
from duobench.real.calibration.views import ViewFolder
from duobench.real.canonical import nominal_pose
from duobench.real.rig import CameraConfig, CameraDriver, Rig
from tests.real.lenses import ZED
from tests.real.with_libraries.board_views import view

pytest.importorskip("cv2", reason="It is not installed here: make test-hardware")


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A rig whose head camera shows the board where the command expects it by default."""
    board = SE3.at(0.4, 0.12, 0.0, yaw=-math.pi / 2)
    pose = nominal_pose("head").inverse() @ board
    picture = tmp_path / "seen.png"
    Image.fromarray(view(Board(), pose, ZED, np.random.default_rng(0))).save(picture)
    known = replace(ZED, pose=tuple(nominal_pose("head").tquat.tolist()))
    head = CameraConfig(driver=CameraDriver.FILE, device=str(picture), calibration=known)
    path = tmp_path / "rig.json"
    replace(Rig.simulated(), cameras={"head": head}).write(path)
    return path


def calibrate(rig: Path, *words: str) -> None:
    views = str(rig.parent / "views")
    options = ["--rig", str(rig), "--views", views, "--ruler", "200", *words]
    main(["real", "calibrate", "head", *options])


def test_images_are_taken_at_enter_and_measured(
    rig: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = Rig.read(rig)
    monkeypatch.setattr("sys.stdin", io.StringIO("\n\nd\n"))
    calibrate(rig)
    output = capsys.readouterr().out
    assert "2: 28 of 28 corners" in output
    after = Rig.read(rig)
    found = after.cameras["head"].calibration
    assert found is not None
    assert found.views == 2
    distance, angle = SE3.from_tquat(found.pose).distance(nominal_pose("head"))
    assert distance < 0.005
    assert math.degrees(angle) < 0.5
    assert after.hash != before.hash
    assert len(ViewFolder(tmp_path / "views", "head")) == 2
    again = rig.read_bytes()
    calibrate(rig)
    assert rig.read_bytes() == again, "measured again offline"


@pytest.mark.parametrize(
    ("typed", "at", "complaint"),
    [
        ("\nd\n", ["--at", "400", "120", "90"], "Does the board lie where it was said"),
        ("", [], "holds no images"),
    ],
)
def test_a_rig_is_left_alone_without_images_or_when_the_board_lies_elsewhere(
    typed: str, at: list[str], complaint: str, rig: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = rig.read_bytes()
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    with pytest.raises(SystemExit, match=complaint):
        calibrate(rig, *at)
    assert rig.read_bytes() == before
