"""The board that cameras are calibrated with: a chessboard with markers in its white squares.

Frame of the board: origin in the corner at the beginning of the ruler, x along the ruler, y away
from it, z out of the paper. A print that is not to scale moves cameras by centimetres and turns
them hardly at all, so that nothing else tells: the printed ruler has to be measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.errors import CalibrationError, OptionError
from duobench.machine import install_extra
from duobench.types import Array

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


@dataclass(frozen=True, kw_only=True, slots=True)
class Paper:
    """A sheet, and what is printed on it."""

    width: float
    """Width in mm."""
    height: float
    """Height in mm."""
    square: float
    """Edge of a square in mm."""
    ruler: float
    """Length of the ruler in mm."""


PAPERS = {
    "a4": Paper(width=297.0, height=210.0, square=30.0, ruler=200.0),
    "a3": Paper(width=420.0, height=297.0, square=42.0, ruler=300.0),
}
"""Sheets by name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Board:
    """A printed board."""

    paper: str = "a4"
    """Name of its sheet."""
    scale: float = 1.0
    """Size of the print as a multiple of what it should be."""

    def __post_init__(self) -> None:
        """Reject sheets that are not known."""
        if self.paper not in PAPERS:
            raise OptionError(f"Boards are on {' or '.join(PAPERS)}, got {self.paper!r}.")
        if not 1 - LARGEST_DEVIATION <= self.scale <= 1 + LARGEST_DEVIATION:
            raise OptionError(f"A board's scale is about 1, got {self.scale}.")

    def measured(self, ruler_mm: float) -> Board:
        """The board as it was printed.

        Args:
            ruler_mm: Length of its printed ruler in mm, measured with another ruler.

        Raises:
            CalibrationError: The length is too far from what it should be.
        """
        wanted = PAPERS[self.paper].ruler
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
        return PAPERS[self.paper].square * self.scale / 1000.0

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
        return self.square * np.stack([across, ROWS - down, 0 * numbers], axis=-1).astype(float)

    def pattern(self, pixels: int = 12) -> NDArray[np.uint8]:
        """Black (0) and white (255) of the board, seen from the front with the ruler below.

        Args:
            pixels: Pixels along the edge of a square; a multiple of 8.
        """
        cells = np.full((ROWS * pixels, COLUMNS * pixels), 255, np.uint8)
        for x, y, width, height in rectangles():
            rows = slice(round((ROWS - y - height) * pixels), round((ROWS - y) * pixels))
            cells[rows, round(x * pixels) : round((x + width) * pixels)] = 0
        return cells


@cache
def markers() -> tuple[NDArray[np.uint8], ...]:
    """The 20 markers (4, 4) of 0, black, and 1, white, found by trying random ones in a row."""
    random = np.random.default_rng(_SEED)
    found: list[NDArray[np.uint8]] = []
    while len(found) < MARKERS:
        new = random.integers(0, 2, (BITS, BITS), dtype=np.uint8)
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
    """OpenCV, with what calibration needs of it.

    Raises:
        CalibrationError: It is missing, or too new.
    """
    try:
        import cv2  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise CalibrationError(
            f"Calibration needs OpenCV ({error}). {install_extra('hardware')}"
        ) from error
    if not hasattr(cv2, "calibrateHandEye"):
        raise CalibrationError(
            f"OpenCV {cv2.__version__} cannot calibrate arms with cameras; 4.10 to 4.13 can."
        )
    return cv2


def detector_of(board: Board) -> Any:
    """OpenCV's detector of a board.

    Raises:
        CalibrationError: OpenCV is missing.
    """
    cv2 = opencv()
    lists = [cv2.aruco.Dictionary.getByteListFromBits(bits) for bits in markers()]
    words = cv2.aruco.Dictionary(np.concatenate(lists), BITS, (DISTANCE - 1) // 2)
    known = cv2.aruco.CharucoBoard(
        (COLUMNS, ROWS), board.square, MARKER_SHARE * board.square, words
    )
    return cv2.aruco.CharucoDetector(known)
