"""The board that is printed, and its PDF."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from duobench.errors import CalibrationError, OptionError
from duobench.hardware.calibration.board import (
    COLUMNS,
    DISTANCE,
    MARKERS,
    PAPERS,
    ROWS,
    Board,
    markers,
)
from duobench.hardware.calibration.pdf import POINTS, write_board


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
    pattern = board.pattern(pixels)
    assert pattern.shape == (ROWS * pixels, COLUMNS * pixels)
    for x, y, _ in corners / board.square * pixels:
        row, column = round(ROWS * pixels - y), round(x)
        around = pattern[row - 2 : row + 2, column - 2 : column + 2]
        assert around[0, 0] == around[-1, -1] != around[0, -1] == around[-1, 0]


def test_a_print_has_the_size_of_its_ruler() -> None:
    board = Board().measured(195.2)
    assert board.square == pytest.approx(0.03 * 0.976)
    assert Board(paper="a3").measured(300.0) == Board(paper="a3")


@pytest.mark.parametrize("ruler", [20.0, 7.87, 250.0, float("nan")])
def test_a_ruler_that_was_measured_wrongly_is_refused(ruler: float) -> None:
    with pytest.raises(CalibrationError, match="is 200 mm long if it was printed to scale"):
        Board().measured(ruler)


def test_unknown_paper_is_refused() -> None:
    with pytest.raises(OptionError, match="a4 or a3, got 'letter'"):
        Board(paper="letter")


@pytest.mark.parametrize("name", PAPERS)
def test_the_sheet_is_drawn_to_scale(name: str, tmp_path: Path) -> None:
    board, paper = Board(paper=name), PAPERS[name]
    write_board(board, tmp_path / "a.pdf")
    write_board(board, tmp_path / "b.pdf")
    data = (tmp_path / "a.pdf").read_bytes()
    assert data == (tmp_path / "b.pdf").read_bytes()
    width, height = re.findall(rb"MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data)[0]
    assert (float(width) / POINTS, float(height) / POINTS) == pytest.approx(
        (paper.width, paper.height), abs=1e-3
    )
    start, end = re.findall(rb"0\.15 w ([\d.]+) [\d.]+ m ([\d.]+) ", data)[0]
    assert float(end) - float(start) == pytest.approx(paper.ruler, abs=1e-3)
    boxes = np.array(
        [[float(each) for each in box.split()] for box in re.findall(rb"([\d. ]+) re\n", data)]
    )
    spans = (boxes[:, :2] + boxes[:, 2:]).max(axis=0) - boxes[:, :2].min(axis=0)
    np.testing.assert_allclose(spans, [COLUMNS * paper.square, ROWS * paper.square], atol=1e-3)
    assert boxes[:, 0].min() > 8.0, "printers do not reach the edge"
    assert (boxes[:, 0] + boxes[:, 2]).max() < paper.width - 8.0
    assert (boxes[:, 1] + boxes[:, 3]).max() < paper.height - 8.0


def test_places_of_objects_in_the_file_are_right(tmp_path: Path) -> None:
    write_board(Board(), tmp_path / "a.pdf")
    data = (tmp_path / "a.pdf").read_bytes()
    assert data.startswith(b"%PDF-1.4\n")
    table = int(data.split(b"startxref\n")[1].split(b"\n")[0])
    assert data[table:].startswith(b"xref\n0 6\n")
    places = re.findall(rb"(\d{10}) 00000 n \n", data)
    for number, place in enumerate(places, start=1):
        assert data[int(place) :].startswith(b"%d 0 obj" % number)
