"""`duobench real calibrate board`: the board, to print."""

from __future__ import annotations

from pathlib import Path

from duobench.cli.shared.console import say
from duobench.core.sheets import Paper
from duobench.real.calibration.board import RULER_MM, Board, write_board


def run(out: Path, paper: Paper = Paper.A4) -> None:
    """Write the board as a PDF, to print at 100 %.

    Args:
        out: The PDF.
        paper: Size of the sheet.
    """
    write_board(Board(paper=paper), out)
    say(
        f"{out}: print it at 100 %, glue it flat onto a plate, and measure its ruler, which should "
        f"be {RULER_MM[paper]:g} mm long."
    )
