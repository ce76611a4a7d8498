"""The lens of a camera, from images of the board in many places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from duobench.backend import Image
from duobench.errors import CalibrationError
from duobench.hardware.calibration.board import (
    Board,
    Detector,
    board_pose,
    offsets,
    opencv,
    rms,
    split_views,
)
from duobench.hardware.rig import UNPOSED, CameraCalibration

FEWEST_VIEWS = 10
LARGEST_ERROR_PX = 1.0
"""Error on held-out images from which something is wrong."""


def calibrate_lens(images: Sequence[Image], board: Board) -> CameraCalibration:
    """Focal lengths, middle and distortion of a camera, without its place.

    Images show the board from many sides and in all their parts, at least ten times; every fifth
    is held out. The scale of the board does not matter here.

    Raises:
        CalibrationError: Too few images show the board, or they do not fit one lens.
    """
    height, width, _ = images[0].shape
    found = Detector(board).find_all(images, FEWEST_VIEWS)
    used, held = split_views([detection for _, detection in found])
    _, matrix, distortion, _, _ = opencv().calibrateCamera(
        [each.points.astype(np.float32) for each in used],
        [each.pixels.astype(np.float32) for each in used],
        (width, height),
        None,
        None,
    )
    lens = CameraCalibration(
        fx=float(matrix[0, 0]),
        fy=float(matrix[1, 1]),
        cx=float(matrix[0, 2]),
        cy=float(matrix[1, 2]),
        distortion=tuple(float(each) for each in np.ravel(distortion)[:5]),
        pose=UNPOSED,
    )
    error = rms([offsets(each, board_pose(each, lens), lens) for each in held])
    if error > LARGEST_ERROR_PX:
        raise CalibrationError(
            f"Images that were held out are off by {error:.2f} px with the lens that was found; at "
            f"most {LARGEST_ERROR_PX:g} is usual. Is the board flat, and were the images sharp?"
        )
    return lens
