"""Rendered views of the calibration board: plane, lens, blur and noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from duobench.core.backend import Image
from duobench.core.spatial import SE3
from duobench.real.calibration.board import Board
from duobench.real.canonical import remapped
from duobench.real.rig import CameraCalibration
from tests.real.lenses import directions_of, pattern

cv2: Any = pytest.importorskip("cv2", reason="It is not installed here: make test-hardware")

NOISE = 4.0
"""Standard deviation of the noise of a pixel, of 255."""
PAPER_MARGIN = 0.03
"""White paper around the board in metres."""


def view(
    board: Board,
    camera_from_board: SE3,
    lens: CameraCalibration,
    random: np.random.Generator,
) -> Image:
    """What a camera sees of a board on grey ground (720, 1280, 3)."""
    directions = directions_of(lens)
    rays = np.dstack([directions, np.ones(directions.shape[:2])])
    board_from_camera = camera_from_board.inverse()
    eye = board_from_camera.translation
    rays = rays @ board_from_camera.rotation.T
    reach = -eye[2] / rays[..., 2]
    places = eye[:2] + reach[..., None] * rays[..., :2]
    distance = float(np.linalg.norm(camera_from_board.apply(board.middle)))
    per_square = max(8, 8 * round(lens.fx * board.square / distance / 8))
    border = round(PAPER_MARGIN / board.square * per_square)
    printed = np.pad(pattern(per_square), border, constant_values=255)
    scale = per_square / board.square
    height = printed.shape[0]
    pixels = np.stack(
        [
            places[..., 0] * scale + border - 0.5,
            height - (places[..., 1] * scale + border) - 0.5,
        ],
        axis=-1,
    )
    pixels[reach <= 0] = -1.0
    sheet = np.repeat((30 + printed * 0.8)[..., None].astype(np.uint8), 3, axis=-1)
    image = remapped(sheet, pixels).astype(np.float32)
    image[image.max(axis=-1) == 0] = 110.0
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + random.normal(0, NOISE, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)
