"""Folders of images and joints, from which cameras are calibrated."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from duobench.core.errors import CalibrationError, FileError
from duobench.real.calibration.views import ViewFolder


def image(value: int, size: tuple[int, int] = (6, 8)) -> np.ndarray:
    return np.full((*size, 3), value, np.uint8)


def test_what_was_added_is_read_again(tmp_path: Path) -> None:
    folder = ViewFolder(tmp_path / "views", "left_wrist")
    assert len(folder) == 0
    for number in range(3):
        folder.add(image(number), np.full(7, 0.1 * number))
    again = ViewFolder(tmp_path / "views", "left_wrist")
    views = again.views()
    assert [int(view.image[0, 0, 0]) for view in views] == [0, 1, 2]
    np.testing.assert_array_equal(views[2].joints, np.full(7, 0.2))
    again.add(image(9), np.zeros(7))
    assert len(ViewFolder(tmp_path / "views", "left_wrist")) == 4


def test_images_alone_are_enough_without_joints(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("x")
    for name in ("b.jpg", "a.png"):
        Image.fromarray(image(5)).save(tmp_path / name)
    folder = ViewFolder(tmp_path, "head")
    assert len(folder.images()) == 2
    with pytest.raises(CalibrationError, match="the joints of the arm"):
        folder.views()


def test_folders_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="holds no images"):
        ViewFolder(tmp_path / "none", "head").images()
    folder = ViewFolder(tmp_path / "a", "head")
    folder.add(image(1))
    with pytest.raises(CalibrationError, match="holds images of head, not of left_wrist"):
        ViewFolder(tmp_path / "a", "left_wrist")
    folder.add(image(1, (6, 10)))
    with pytest.raises(CalibrationError, match="several sizes"):
        folder.images()
    (tmp_path / "a" / "000.png").write_bytes(b"no image")
    with pytest.raises(FileError, match=r"000\.png cannot be read as an image"):
        folder.images()
    document = json.loads((tmp_path / "a" / "views.json").read_text())
    (tmp_path / "a" / "views.json").write_text(json.dumps({**document, "views": 3}))
    with pytest.raises(FileError, match=r"views\.json"):
        ViewFolder(tmp_path / "a", "head")
