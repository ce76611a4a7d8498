"""Sheets of paper: true size, and the same bytes whatever the user's settings."""

import matplotlib as mpl
import numpy as np
import pytest

from duobench.core.sheets import Paper, Sheet, pdf
from tests.pdfs import read_pdf


def drawn() -> list[Sheet]:
    sheet = Sheet(*Paper.A4.size)
    sheet.line((10.0, 20.0), (110.0, 20.0), line=0.4)
    sheet.line((10.0, 30.0), (10.0, 60.0), line=0.4, dash=1.5)
    turns = np.linspace(0.0, 6.0, 400)
    sheet.polygon(100 + 50 * np.column_stack([np.cos(turns), np.sin(turns)]), fill=0.85)
    sheet.rectangles([(10.0, 200.0, 20.0, 5.0), (30.0, 200.0, 1.0, 2.0)])
    sheet.text(20.0, 20.0, r"yaw 28.6° (a \ $test$) ☃", bold=True)
    return [sheet, Sheet(*Paper.A3.size)]


def test_what_is_drawn_is_in_its_place_and_has_its_true_size() -> None:
    first, second = read_pdf(pdf(drawn(), "A test"))
    assert first.size == pytest.approx((210.0, 297.0), abs=1e-6)
    assert second.size == pytest.approx((297.0, 420.0), abs=1e-6)
    assert first.lines(0.4) == pytest.approx(np.array([[[10.0, 20.0], [110.0, 20.0]]]), abs=1e-5)
    assert [is_dashed for _, is_dashed, _ in first.stroked] == [False, True, False]
    circle, *boxes = first.filled
    assert len(circle) >= 400, "no point is left out"
    assert np.hypot(*(circle - 100).T) == pytest.approx(np.full(len(circle), 50.0), abs=1e-5)
    assert [box.min(axis=0).round(4).tolist() for box in boxes] == [[10.0, 200.0], [30.0, 200.0]]
    assert [np.ptp(box, axis=0).round(4).tolist() for box in boxes] == [[20.0, 5.0], [1.0, 2.0]]
    assert first.texts == [r"yaw 28.6° (a \ $test$) ?"]


def test_nobodys_settings_change_the_bytes() -> None:
    data = pdf(drawn(), "A (title) \\")
    with mpl.rc_context({"savefig.bbox": "tight", "pdf.compression": 9, "path.sketch": (1, 2, 3)}):
        assert pdf(drawn(), "A (title) \\") == data
    assert b"Date" not in data
    assert mpl.__version__.encode() not in data


def test_the_viewer_is_asked_not_to_scale() -> None:
    assert b"/PrintScaling /None" in pdf([Sheet(100.0, 100.0)], "A title")
