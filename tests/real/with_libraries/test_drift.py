"""Whether the head camera was moved, by OpenCV's phase correlation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from duobench.cli import main
from duobench.real.doctor.checks import CheckOutcome
from duobench.real.doctor.examine import examine, shift_between
from duobench.real.rig import CameraConfig
from duobench.world.robot.cameras import HEAD
from tests.real.rigs import new_rig
from tests.real.simulated import CAMERA, SimulatedCamera, simulated_rig

pytest.importorskip("cv2", reason="It is not installed here: make test-hardware")


@cache
def scene(right: float = 0.0, down: float = 0.0) -> np.ndarray:
    """A picture with structure, moved by some pixels."""
    rows, columns = np.mgrid[0:720, 0:1280]
    random = np.random.default_rng(4)
    picture = np.zeros((720, 1280))
    for _ in range(12):
        wave = random.uniform(0.02, 0.6, 2) * random.choice([-1, 1], 2)
        phase = random.uniform(0, 6.3)
        picture += np.sin(wave[0] * (columns - right) + wave[1] * (rows - down) + phase)
    grey = np.clip(127 + 24 * picture, 0, 255)
    return np.repeat(grey[..., None], 3, axis=-1).astype(np.uint8)


@pytest.mark.parametrize(("right", "down"), [(0.0, 0.0), (3.0, -2.0), (-12.4, 7.3)])
def test_how_far_a_camera_was_moved_is_found(right: float, down: float) -> None:
    now = scene(right, down)
    noise = np.random.default_rng(0).normal(0, 3, now.shape)
    now = np.clip(now + noise, 0, 255).astype(np.uint8)
    now[200:500, 300:700] = 90  # arms and objects are elsewhere
    shift = shift_between(now, scene())
    assert shift is not None
    assert shift == pytest.approx((right, down), abs=0.35)


def test_images_that_show_something_else_have_no_shift() -> None:
    random = np.random.default_rng(1)
    noise = random.integers(0, 255, (2, 720, 1280, 3), dtype=np.uint8)
    assert shift_between(noise[0], noise[1]) is None
    assert shift_between(np.zeros_like(noise[0]), noise[1]) is None


@pytest.mark.parametrize(
    ("pixels", "outcome"),
    [(0.0, CheckOutcome.OK), (2.0, CheckOutcome.NOTE), (6.0, CheckOutcome.FAILED)],
)
def test_the_reference_decides(pixels: float, outcome: CheckOutcome) -> None:
    duo, moved = new_rig(), scene(pixels)
    duo.cameras[HEAD] = SimulatedCamera(
        CameraConfig(driver=CAMERA), duo.clock, HEAD, source=lambda *_: moved
    )
    checks = {check.name: check for check in examine(duo, seconds=0.1, reference=scene())}
    duo.close()
    check = checks["head camera's place"]
    assert check.outcome is outcome
    assert f"{pixels:.0f}." in check.value or pixels == 0.0


def test_a_camera_that_was_moved_is_found_by_its_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def doctor(*words: str) -> str:
        arguments = ["--rig", str(rig), "--out", str(tmp_path / "run"), "--seconds", "1", *words]
        main(["real", "doctor", *arguments])
        return capsys.readouterr().out

    noise = np.random.default_rng(0).integers(0, 256, (76, 132, 3), dtype=np.uint8)
    scene = Image.fromarray(noise).resize((1320, 760), Image.Resampling.BICUBIC)
    picture, rig = tmp_path / "seen.png", tmp_path / "rig.json"
    scene.crop((10, 10, 1290, 730)).save(picture)
    head = CameraConfig(driver="file", device=str(picture))
    replace(simulated_rig(), name="lab", cameras={"head": head}).write(rig)
    assert "no reference was stored" in doctor("--no-hold")
    assert "Reference: " in doctor("--no-hold", "--store-reference")
    assert (tmp_path / "rig.head.png").exists()
    assert "px from the reference" in doctor()
    scene.crop((18, 10, 1298, 730)).save(picture)
    with pytest.raises(SystemExit):
        doctor()
    assert "calibrate it again" in capsys.readouterr().out
