"""The board that is printed, and its PDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from duobench.core.errors import CalibrationError
from duobench.core.sheets import Paper
from duobench.real.calibration.board import (
    COLUMNS,
    DISTANCE,
    MARKERS,
    ROWS,
    RULER_MM,
    SQUARE_MM,
    Board,
    markers,
    rectangles,
    write_board,
)
from tests.pdfs import read_pdf
from tests.real.lenses import pattern


def test_markers_differ_however_they_are_turned() -> None:
    found = markers()
    assert len(found) == MARKERS == 20
    for number, marker in enumerate(found):
        for other in found[number:]:
            turned = [np.rot90(other, turns) for turns in range(4)]
            distances = [np.count_nonzero(marker != each) for each in turned]
            assert min(distances[1:] if other is marker else distances) >= DISTANCE


def test_corners_are_where_squares_meet() -> None:
    board = Board()
    corners = board.corners
    assert corners.shape == ((COLUMNS - 1) * (ROWS - 1), 3)
    np.testing.assert_allclose(corners[0], [0.03, 0.12, 0.0])
    np.testing.assert_allclose(corners[-1], [0.21, 0.03, 0.0])
    np.testing.assert_allclose(board.middle, [0.12, 0.075, 0.0])
    pixels = 24
    image = pattern(pixels)
    assert image.shape == (ROWS * pixels, COLUMNS * pixels)
    for x, y, _ in corners / board.square * pixels:
        row, column = round(ROWS * pixels - y), round(x)
        around = image[row - 2 : row + 2, column - 2 : column + 2]
        assert around[0, 0] == around[-1, -1] != around[0, -1] == around[-1, 0]


def test_a_print_has_the_size_of_its_ruler() -> None:
    board = Board().measured(195.2)
    assert board.square == pytest.approx(0.03 * 0.976)
    assert Board(paper=Paper.A3).measured(300.0) == Board(paper=Paper.A3)


@pytest.mark.parametrize("ruler", [20.0, 7.87, 250.0, float("nan")])
def test_a_ruler_that_was_measured_wrongly_is_refused(ruler: float) -> None:
    with pytest.raises(CalibrationError, match="is 200 mm long if it was printed to scale"):
        Board().measured(ruler)


@pytest.mark.parametrize("paper", Paper)
def test_the_sheet_is_drawn_to_scale(paper: Paper, tmp_path: Path) -> None:
    for name in ("a.pdf", "b.pdf"):
        write_board(Board(paper=paper), tmp_path / name)
    data = (tmp_path / "a.pdf").read_bytes()
    assert data == (tmp_path / "b.pdf").read_bytes()
    (page,) = read_pdf(data)
    height, width = paper.size
    assert page.size == pytest.approx((width, height), abs=1e-3)
    (start, end), *_ = page.lines(0.15)
    assert (end - start).tolist() == pytest.approx([RULER_MM[paper], 0.0], abs=1e-3)
    corners = np.concatenate(page.filled)
    square = SQUARE_MM[paper]
    spans = np.ptp(corners, axis=0)
    np.testing.assert_allclose(spans, [COLUMNS * square, ROWS * square], atol=1e-3)
    assert len(page.filled) == len(rectangles())
    assert (corners > 8.0).all(), "printers do not reach the edge"
    assert (corners < [width - 8.0, height - 8.0]).all()
