"""The board as a PDF: black rectangles, a ruler, and what to do with it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from duobench import files
from duobench.hardware.calibration.board import COLUMNS, PAPERS, ROWS, Board, rectangles

POINTS = 72.0 / 25.4
"""Points of PDF in one mm."""
_RULER_Y, _BOARD_Y = 24.0, 40.0
_LINES = (
    "Print at 100 % (actual size, no fit to page), on stiff paper or glued flat onto a plate.",
    "Then measure this ruler from its first to its last mark, and give its length in mm.",
)


def write_board(board: Board, path: Path) -> None:
    """Write a sheet to print; the same board always gives the same bytes.

    Raises:
        OutputError: It cannot be written.
    """
    files.write(path, _pdf(board))


def _pdf(board: Board) -> bytes:
    paper = PAPERS[board.paper]
    content = "\n".join(_content(board)).encode("ascii")
    size = f"{paper.width * POINTS:.3f} {paper.height * POINTS:.3f}"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {size}] /Contents 4 0 R "
        "/Resources << /Font << /F 5 0 R >> >> >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    data, places = b"%PDF-1.4\n", []
    for number, each in enumerate(objects, start=1):
        places.append(len(data))
        data += b"%d 0 obj\n%s\nendobj\n" % (number, each)
    count = len(objects) + 1
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    start = len(data)
    data += b"xref\n0 %d\n0000000000 65535 f \n%s" % (count, table)
    return data + b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (count, start)


def _content(board: Board) -> Iterator[str]:
    """Operators of the page, in mm from its lower left corner."""
    paper = PAPERS[board.paper]
    yield f"{POINTS:.6f} 0 0 {POINTS:.6f} 0 0 cm"
    square = paper.square
    left = (paper.width - COLUMNS * square) / 2.0
    for x, y, width, height in rectangles():
        corner = f"{left + x * square:.4f} {_BOARD_Y + y * square:.4f}"
        yield f"{corner} {width * square:.4f} {height * square:.4f} re"
    yield "f"
    yield from _axes(left)
    yield from _ruler((paper.width - paper.ruler) / 2.0, paper.ruler)
    for number, line in enumerate(_LINES):
        yield _text((paper.width - paper.ruler) / 2.0, 12.0 - 4.5 * number, 3.2, line)
    title = f"DuoBench board, {board.paper.upper()}: {COLUMNS} x {ROWS} squares of {square:g} mm"
    yield _text(left, _BOARD_Y + ROWS * square + 4.0, 3.2, title)


def _axes(left: float) -> Iterator[str]:
    """The origin and the axes, beside the board's lower left corner."""
    x, y = left - 3.0, _BOARD_Y - 3.0
    yield f"0.3 w {x:.3f} {y:.3f} m {x + 15:.3f} {y:.3f} l S"
    yield f"{x:.3f} {y:.3f} m {x:.3f} {y + 15:.3f} l S"
    yield _text(x + 16.0, y - 1.0, 3.0, "x (the corner of the first square is the origin)")
    yield _text(x - 1.0, y + 16.0, 3.0, "y")


def _ruler(left: float, length: float) -> Iterator[str]:
    yield f"0.15 w {left:.3f} {_RULER_Y:.3f} m {left + length:.3f} {_RULER_Y:.3f} l S"
    for mark in range(int(length) + 1):
        height = 6.0 if mark % 10 == 0 else 4.0 if mark % 5 == 0 else 2.5
        x = left + mark
        yield f"{x:.3f} {_RULER_Y:.3f} m {x:.3f} {_RULER_Y + height:.3f} l S"
        if mark % 10 == 0:
            yield _text(x - 0.9 * len(str(mark)), _RULER_Y - 4.0, 3.0, str(mark))


def _text(x: float, y: float, size: float, text: str) -> str:
    escaped = text.replace("(", r"\(").replace(")", r"\)")
    return f"BT /F {size:g} Tf {x:.3f} {y:.3f} Td ({escaped}) Tj ET"
