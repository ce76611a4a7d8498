"""The board that cameras are calibrated with: a chessboard with markers in its white squares.

Frame of the board: origin in the corner at the beginning of the ruler, x along the ruler, y away
from it, z out of the paper. A print that is not to scale moves cameras by centimetres and turns
them hardly at all, so that nothing else tells: the printed ruler has to be measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from duobench.core import files
from duobench.core.backend import Image
from duobench.core.errors import CalibrationError
from duobench.core.machine import load_extra
from duobench.core.sheets import (
    CAPITAL,
    Paper,
    Sheet,
    pdf,
)
from duobench.core.spatial import SE3
from duobench.core.types import Array
from duobench.real.canonical import distorted
from duobench.real.rig import CameraCalibration

T = TypeVar("T")
COLUMNS, ROWS = 8, 5
"""Squares of the board."""
BITS = 4
"""Bits along the edge of a marker, without its black border."""
MARKERS = COLUMNS * ROWS // 2
MARKER_SHARE = 0.75
"""Edge of a marker as a share of that of a square."""
DISTANCE = 4
"""Bits in which two markers differ at least, however they are turned."""
LARGEST_DEVIATION = 0.1
"""Deviation of a ruler's length at which a mistake in measuring is likelier than a bad print."""
_SEED = 20
_RULER_Y, _BOARD_Y = 24.0, 40.0
_LINES = (
    "Print at 100 % (actual size, no fit to page), on stiff paper or glued flat onto a plate.",
    "Then measure this ruler from its first to its last mark, and give its length in mm.",
)
SQUARE_MM = {Paper.A4: 30.0, Paper.A3: 42.0}
"""Edge of a square in mm by the size of the sheet, which lies on its longer side."""
RULER_MM = {Paper.A4: 200.0, Paper.A3: 300.0}


@dataclass(frozen=True, kw_only=True, slots=True)
class Board:
    """A printed board."""

    paper: Paper = Paper.A4
    scale: float = 1.0
    """Size of the print as a multiple of what it should be."""

    def measured(self, ruler_mm: float) -> Board:
        """The board as it was printed, with a ruler of that many mm by another ruler."""
        wanted = RULER_MM[self.paper]
        if not abs(ruler_mm / wanted - 1.0) <= LARGEST_DEVIATION:
            raise CalibrationError(
                f"The ruler on the {self.paper} board is {wanted:g} mm long if it was printed to "
                f"scale; {ruler_mm:g} mm is too far from it. Measure it from its first to its last "
                "mark, in mm, or print the board again at 100 %."
            )
        return replace(self, scale=ruler_mm / wanted)

    @property
    def square(self) -> float:
        """Edge of a square in metres, as printed."""
        return SQUARE_MM[self.paper] * self.scale / 1000.0

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in metres, as printed."""
        return COLUMNS * self.square, ROWS * self.square

    @property
    def middle(self) -> Array:
        """Its middle (3,) in its own frame, in metres."""
        return np.array([*self.size, 0.0]) / 2.0

    @property
    def corners(self) -> Array:
        """Inner corners (28, 3) in its own frame, in metres, in the order of their numbers."""
        numbers = np.arange((COLUMNS - 1) * (ROWS - 1))
        across = 1 + numbers % (COLUMNS - 1)
        down = 1 + numbers // (COLUMNS - 1)
        return self.square * np.stack(
            [across, ROWS - down, 0 * numbers], axis=-1
        ).astype(float)


@cache
def markers() -> tuple[NDArray[np.uint8], ...]:
    """The 20 markers (4, 4) of 0, black, and 1, white, found by trying random ones in a row."""
    random = np.random.default_rng(_SEED)
    found: list[NDArray[np.uint8]] = []
    while len(found) < MARKERS:
        new = random.integers(
            0,
            2,
            (BITS, BITS),
            dtype=np.uint8,
        )
        turned = [np.rot90(new, turns) for turns in range(4)]
        others = [(new, each) for each in turned[1:]]
        others += [(each, old) for old in found for each in turned]
        is_mixed = BITS <= new.sum() <= BITS * (BITS - 1)
        if is_mixed and all(np.count_nonzero(a != b) >= DISTANCE for a, b in others):
            found.append(new)
    return tuple(found)


def rectangles() -> list[tuple[float, float, float, float]]:
    """All black rectangles of the board: x, y, width and height in squares, in its frame."""
    found: list[tuple[float, float, float, float]] = []
    margin, cell = (1.0 - MARKER_SHARE) / 2.0, MARKER_SHARE / (BITS + 2)
    number = 0
    for down in range(ROWS):
        for across in range(COLUMNS):
            x, y = float(across), float(ROWS - 1 - down)
            if (down + across) % 2 == 0:
                found.append((x, y, 1.0, 1.0))
                continue
            bits = np.pad(markers()[number], 1)
            number += 1
            for row, column in np.argwhere(bits == 0).tolist():
                left = x + margin + column * cell
                bottom = y + margin + (BITS + 1 - row) * cell
                found.append((left, bottom, cell, cell))
    return found


def opencv() -> Any:
    """OpenCV, with what calibration needs of it."""
    cv2 = load_extra("cv2", "hardware", "Calibration needs OpenCV", CalibrationError)
    if not hasattr(cv2, "calibrateHandEye"):
        raise CalibrationError(
            f"OpenCV {cv2.__version__} cannot calibrate arms with cameras; 4.10 to 4.13 can."
        )
    return cv2


# --- the sheet ---


def write_board(board: Board, path: Path) -> None:
    """Write a sheet to print as PDF; the same board always gives the same bytes."""
    height, width = board.paper.size
    sheet = Sheet(width, height)
    square, ruler = SQUARE_MM[board.paper], RULER_MM[board.paper]
    left, beside = (width - COLUMNS * square) / 2.0, (width - ruler) / 2.0
    sheet.rectangles(
        (left + square * x, _BOARD_Y + square * y, square * across, square * up)
        for x, y, across, up in rectangles()
    )
    x, y = left - 3.0, _BOARD_Y - 3.0
    sheet.line((x, y), (x + 15.0, y))
    sheet.line((x, y), (x, y + 15.0))
    size = 3.0 * CAPITAL
    sheet.text(
        x + 16.0, y - 1.0, "x (the corner of the first square is the origin)", size
    )
    sheet.text(x - 1.0, y + 16.0, "y", size)
    _draw_ruler(sheet, beside, ruler)
    for number, line in enumerate(_LINES):
        sheet.text(beside, 12.0 - 4.5 * number, line, 3.2 * CAPITAL)
    title = f"DuoBench board, {board.paper.upper()}: {COLUMNS} x {ROWS} squares of {square:g} mm"
    sheet.text(left, _BOARD_Y + ROWS * square + 4.0, title, 3.2 * CAPITAL)
    files.write(path, pdf([sheet], title))


def _draw_ruler(
    sheet: Sheet,
    left: float,
    length: float,
) -> None:
    sheet.line((left, _RULER_Y), (left + length, _RULER_Y), line=0.15)
    for mark in range(int(length) + 1):
        height = 6.0 if mark % 10 == 0 else 4.0 if mark % 5 == 0 else 2.5
        x = left + mark
        sheet.line((x, _RULER_Y), (x, _RULER_Y + height), line=0.15)
        if mark % 10 == 0:
            sheet.text(
                x - 0.9 * len(str(mark)), _RULER_Y - 4.0, str(mark), 3.0 * CAPITAL
            )


# --- in images ---

FEWEST_CORNERS = 8
"""Corners of the 28 that an image has to show."""
WINDOW = 0.12
"""Half of the window in which a corner is refined, in squares; markers begin at 0.125."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Detection:
    """Corners of the board in one image."""

    points: Array
    """Corners (n, 3) in the frame of the board, in metres."""
    pixels: Array
    """Their places in the image (n, 2), in pixels."""


class Detector:
    """Finds the corners of a board in images."""

    def __init__(self, board: Board) -> None:
        aruco = opencv().aruco
        lists = [aruco.Dictionary.getByteListFromBits(bits) for bits in markers()]
        words = aruco.Dictionary(np.concatenate(lists), BITS, (DISTANCE - 1) // 2)
        marker = MARKER_SHARE * board.square
        known = aruco.CharucoBoard((COLUMNS, ROWS), board.square, marker, words)
        self._detector: Any = aruco.CharucoDetector(known)
        self._corners = board.corners

    def find(self, image: Image) -> Detection | None:
        """The corners in an image (height, width, 3); None where too few are seen."""
        cv2 = opencv()
        grey = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        corners, numbers, _, _ = self._detector.detectBoard(grey)
        if numbers is None or len(numbers) < FEWEST_CORNERS:
            return None
        # Corners that the board's detector gives are half a pixel off in some versions of OpenCV
        # (measured in 4.13); these are 0 in the middle of the first pixel.
        places = np.asarray(corners, np.float32).reshape(-1, 2)
        distances = np.linalg.norm(places[:, None] - places[None], axis=-1)
        np.fill_diagonal(distances, np.inf)
        half = int(np.clip(WINDOW * np.median(distances.min(axis=1)), 2, 6))
        ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
        refined = cv2.cornerSubPix(
            grey, places.reshape(-1, 1, 2), (half, half), (-1, -1), ends
        )
        pixels = refined.reshape(-1, 2).astype(np.float64)
        return Detection(points=self._corners[np.ravel(numbers)], pixels=pixels)

    def find_all(
        self, images: Sequence[Image], fewest: int
    ) -> list[tuple[int, Detection]]:
        """Corners of the images that show the board, with the number of each image."""
        tried = enumerate(map(self.find, images))
        found = [(number, each) for number, each in tried if each is not None]
        if len(found) < fewest:
            raise CalibrationError(
                f"{len(found)} of {len(images)} images show at least {FEWEST_CORNERS} corners of "
                f"the board; {fewest} are needed. The board has to be sharp, lit evenly, and flat."
            )
        return found


def board_pose(detection: Detection, lens: CameraCalibration) -> SE3:
    """Pose of the board in the camera (x right, y down, z forwards)."""
    cv2 = opencv()
    matrix = np.array(
        [[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]]
    )
    is_found, turn, shift = cv2.solvePnP(
        detection.points, detection.pixels, matrix, np.array(lens.distortion)
    )
    if not is_found or not np.all(np.isfinite(shift)) or shift[2, 0] <= 0.0:
        raise CalibrationError("The corners of the board show no pose.")
    return SE3(cv2.Rodrigues(turn)[0], shift.ravel())


def offsets(
    detection: Detection, camera_from_board: SE3, lens: CameraCalibration
) -> Array:
    """Seen pixels less expected ones (n, 2), with the board at a pose."""
    seen = camera_from_board.apply(detection.points)
    return detection.pixels - distorted(seen[:, :2] / seen[:, 2:], lens)


def rms(parts: Sequence[Array]) -> float:
    """Root of the mean square distance in pixels, over offsets (n, 2) of several images."""
    together = np.concatenate(parts)
    return float(np.sqrt(np.mean(np.sum(together**2, axis=-1))))


def split_views(views: Sequence[T]) -> tuple[list[T], list[T]]:
    """The views to measure from, and those that are held out, every fifth one."""
    used, held = list(views), list(views[4::5])
    del used[4::5]
    return used, held
