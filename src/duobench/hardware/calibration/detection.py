"""Corners of the board in images, and where the board is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.backend import Image
from duobench.errors import CalibrationError
from duobench.hardware.calibration.board import Board, detector_of, opencv
from duobench.hardware.rig import CameraCalibration
from duobench.spatial import SE3
from duobench.types import Array

FEWEST_CORNERS = 8
"""Corners of the 28 that an image has to show."""
WINDOW = 0.12
"""Half of the window in which a corner is refined, in squares; markers begin at 0.125."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Detection:
    """Corners of the board in one image."""

    points: Array
    """Corners (n, 3) in the frame of the board, in metres."""
    pixels: Array
    """Where they are in the image (n, 2), in pixels."""


class Detector:
    """Finds the corners of a board in images."""

    def __init__(self, board: Board) -> None:
        """Prepare to find a board.

        Raises:
            CalibrationError: OpenCV is missing.
        """
        self.board = board
        self._detector: Any = detector_of(board)
        self._corners = board.corners

    def find(self, image: Image) -> Detection | None:
        """The corners in an image (height, width, 3); None where too few are seen."""
        cv2 = opencv()
        grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        corners, numbers, _, _ = self._detector.detectBoard(grey)
        if numbers is None or len(numbers) < FEWEST_CORNERS:
            return None
        pixels = self._refined(grey, np.asarray(corners, np.float32).reshape(-1, 1, 2))
        return Detection(points=self._corners[np.ravel(numbers)], pixels=pixels)

    def _refined(self, grey: NDArray[np.uint8], corners: NDArray[np.float32]) -> Array:
        """Corners (n, 2) where the middle of the first pixel is 0.

        Those that the board's detector gives are half a pixel off in some versions of OpenCV
        (measured in 4.13).
        """
        cv2 = opencv()
        places = corners.reshape(-1, 2)
        distances = np.linalg.norm(places[:, None] - places[None], axis=-1)
        np.fill_diagonal(distances, np.inf)
        square = float(np.median(distances.min(axis=1)))
        half = int(np.clip(WINDOW * square, 2, 6))
        ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
        refined = cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), ends)
        return refined.reshape(-1, 2).astype(np.float64)

    def find_all(self, images: Sequence[Image], fewest: int) -> list[tuple[int, Detection]]:
        """Corners of the images that show the board, with the number of each image.

        Raises:
            CalibrationError: Too few images show it.
        """
        found = [
            (number, detection)
            for number, image in enumerate(images)
            if (detection := self.find(image)) is not None
        ]
        if len(found) < fewest:
            raise CalibrationError(
                f"{len(found)} of {len(images)} images show at least {FEWEST_CORNERS} corners of "
                f"the board; {fewest} are needed. The board has to be sharp, lit evenly, and flat."
            )
        return found


def matrix_of(lens: CameraCalibration) -> Array:
    """Matrix (3, 3) of a lens."""
    return np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])


def board_pose(detection: Detection, lens: CameraCalibration) -> SE3:
    """Pose of the board in the camera (x right, y down, z forwards).

    Raises:
        CalibrationError: The corners show no pose.
    """
    cv2 = opencv()
    is_found, turn, shift = cv2.solvePnP(
        detection.points, detection.pixels, matrix_of(lens), np.array(lens.distortion)
    )
    if not is_found or not np.all(np.isfinite(shift)) or shift[2, 0] <= 0.0:
        raise CalibrationError("The corners of the board show no pose.")
    return SE3(cv2.Rodrigues(turn)[0], shift.ravel())


def offsets(detection: Detection, camera_from_board: SE3, lens: CameraCalibration) -> Array:
    """Seen pixels less expected ones (n, 2), with the board at a pose."""
    from duobench.hardware.canonical import distorted

    seen = camera_from_board.apply(detection.points)
    return detection.pixels - distorted(seen[:, :2] / seen[:, 2:], lens)


def rms(parts: Sequence[Array]) -> float:
    """Root of the mean square distance in pixels, over offsets (n, 2) of several images."""
    together = np.concatenate(parts)
    return float(np.sqrt(np.mean(np.sum(together**2, axis=-1))))


def split_views(count: int) -> tuple[list[int], list[int]]:
    """Numbers of the views to measure from, and of those that are held out, every fifth one."""
    held = [number for number in range(count) if number % 5 == 4]  # noqa: PLR2004 - the fifth
    return [number for number in range(count) if number not in held], held
