"""Where cameras are: the head camera on the table, a wrist camera on the flange."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from duobench.backend import Image
from duobench.errors import CalibrationError
from duobench.hardware.calibration.board import Board, opencv
from duobench.hardware.calibration.detection import (
    Detection,
    Detector,
    board_pose,
    offsets,
    rms,
)
from duobench.hardware.canonical import nominal_pose
from duobench.hardware.rig import CameraCalibration
from duobench.spatial import SE3
from duobench.types import HEAD

NOTED_M, NOTED_DEG = 0.03, 8.0
"""Distance and angle to the simulation's camera from which a place is remarked on."""
REFUSED_M, REFUSED_DEG = 0.25, 45.0
"""And from which something must be wrong."""
LARGEST_ERROR_PX = 2.0
"""Error on held-out corners from which something is wrong."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Measured:
    """What a calibration has found."""

    calibration: CameraCalibration
    """Lens and place."""
    error_mm: float | None
    """How far the board's middle is from where it should be, on held-out views; None for a single
    place of the board."""
    notes: tuple[str, ...] = ()
    """What a person should know, one sentence each."""


def locate_head(
    images: Sequence[Image], board: Board, lens: CameraCalibration, table_from_board: SE3
) -> Measured:
    """The place of the head camera, from a board at a known place on the table.

    Args:
        images: One or more images of the board, which lies still; every fifth corner is held out.
        board: The board as it was printed.
        lens: The camera's lens.
        table_from_board: Where the board's frame is on the table, in metres.

    Raises:
        CalibrationError: The board is not seen, or the camera would be somewhere else altogether.
    """
    found = [each for _, each in Detector(board).find_all(images, 1)]
    points = np.concatenate([each.points for each in found])
    pixels = np.concatenate([each.pixels for each in found])
    corners = np.unique(points, axis=0)
    is_held = np.isin(np.arange(len(corners)) % 5, 4)
    held = {tuple(corner) for corner in corners[is_held].tolist()}
    is_test = np.array([tuple(point) in held for point in points.tolist()])
    pose = board_pose(Detection(points=points[~is_test], pixels=pixels[~is_test]), lens)
    test = Detection(points=points[is_test], pixels=pixels[is_test])
    table_from_camera = table_from_board @ pose.inverse()
    error = rms([offsets(test, pose, lens)])
    calibration = described(lens, table_from_camera, "one pose of a board", len(found), error)
    return Measured(calibration=calibration, error_mm=None, notes=checked(HEAD, calibration, error))


def described(
    lens: CameraCalibration, pose: SE3, method: str, views: int, error_px: float
) -> CameraCalibration:
    """A lens with a place, and how it was found."""
    return replace(
        lens,
        pose=tuple(float(each) for each in pose.tquat),
        method=method,
        views=views,
        error_px=round(error_px, 4),
        opencv=str(opencv().__version__),
        date=datetime.now(UTC).date().isoformat(),
    )


def checked(camera: str, calibration: CameraCalibration, error_px: float) -> tuple[str, ...]:
    """What is remarkable about a place.

    Raises:
        CalibrationError: The error is too large, or the place can hardly be true.
    """
    if error_px > LARGEST_ERROR_PX:
        raise CalibrationError(
            f"What was held out is off by {error_px:.2f} px; at most {LARGEST_ERROR_PX:g} is "
            "usual. Did the board move, or was it bent? Are the joints those of this arm?"
        )
    distance, angle = SE3.from_tquat(calibration.pose).distance(nominal_pose(camera))
    degrees = math.degrees(angle)
    text = (
        f"{camera} was found {1000 * distance:.0f} mm and {degrees:.1f} degrees from where the "
        "simulation has it"
    )
    if distance > REFUSED_M or degrees > REFUSED_DEG:
        raise CalibrationError(
            f"{text}. Does the board lie where it was said, with its ruler on the side that was "
            "said, and is it the right camera?"
        )
    return (f"{text}.",) if distance > NOTED_M or degrees > NOTED_DEG else ()
