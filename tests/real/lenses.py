"""Lenses for tests, and images that are seen through them."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from duobench.core.types import Array
from duobench.real.calibration.board import COLUMNS, ROWS, rectangles
from duobench.real.canonical import distorted
from duobench.real.rig import UNPOSED, CameraCalibration

ZED = CameraCalibration(
    fx=700.0,
    fy=702.0,
    cx=651.3,
    cy=352.9,
    distortion=(-0.17, 0.027, 0.0004, -0.0003, 0.0),
    pose=UNPOSED,
)
"""A lens such as that of a ZED Mini: wider than the canonical one, and distorted."""
D405 = CameraCalibration(fx=641.0, fy=640.2, cx=637.1, cy=363.4, pose=UNPOSED)


def pattern(pixels: int) -> NDArray[np.uint8]:
    """Black and white of the board, seen from the front, with a multiple of 8 pixels a square."""
    cells = np.full((ROWS * pixels, COLUMNS * pixels), 255, np.uint8)
    for x, y, width, height in rectangles():
        rows = slice(round((ROWS - y - height) * pixels), round((ROWS - y) * pixels))
        cells[rows, round(x * pixels) : round((x + width) * pixels)] = 0
    return cells


def undistorted(pixels: Array, lens: CameraCalibration) -> Array:
    """Directions (..., 2) that a lens shows in pixels (..., 2), by Newton's method."""
    middle, focal = np.array([lens.cx, lens.cy]), np.array([lens.fx, lens.fy])
    found = (pixels - middle) / focal
    for _ in range(8):
        found = found - (distorted(found, lens) - pixels) / focal
    return found


@cache
def directions_of(lens: CameraCalibration, size: tuple[int, int] = (720, 1280)) -> Array:
    """Where every pixel of a lens looks (height, width, 2)."""
    rows, columns = np.mgrid[0 : size[0], 0 : size[1]]
    return undistorted(np.stack([columns, rows], axis=-1).astype(float), lens)
