"""Comparing runs: the paper's table, tests, figures and one page, computed from records alone.

No file written here depends on a clock, a folder or an order of records: the same runs in the same
order give the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import combinations
from pathlib import Path

from duobench.errors import OtherRunError
from duobench.files import make_folder, write
from duobench.results.comparison import figures
from duobench.results.comparison.comparison import Comparison
from duobench.results.comparison.document import document
from duobench.results.comparison.entrants import read_entrants
from duobench.results.comparison.page import page
from duobench.results.comparison.pairs import compare_pair
from duobench.results.comparison.rows import table_rows
from duobench.results.comparison.tables import csv_text, latex, markdown
from duobench.results.figures import as_svg

DOCUMENT = "comparison.json"
"""The comparison for programs; a folder that has it holds a comparison."""
PAGE = "index.html"
"""The comparison for people."""


def compare(sources: Sequence[str]) -> Comparison:
    """Compare runs, any two of them; nothing is written.

    Args:
        sources: See `read_entrants`.

    Raises:
        EvaluationError: There are too few or too many, none is a run, or one has no episode.
        UnknownNameError: The paper has no such policy.
        FileError: A record cannot be read.
    """
    entrants = read_entrants(sources)
    rows = table_rows(entrants)
    pairs = [compare_pair(a, b, rows) for a, b in combinations(entrants, 2)]
    tested = sorted((pair for pair in pairs if pair), key=lambda pair: pair.crosses_groups)
    return Comparison(entrants=entrants, rows=rows, pairs=tuple(tested))


def write_comparison(comparison: Comparison, out: Path) -> Path:
    """Write page, tables, figures and the JSON form of a comparison.

    Args:
        comparison: What `compare` gave.
        out: Folder, which is made; an earlier comparison in it is replaced.

    Returns:
        The page.

    Raises:
        OtherRunError: The folder holds something else.
        OutputError: It cannot be written.
    """
    is_ours = (out / DOCUMENT).exists()
    if not is_ours and out.is_dir() and any(out.iterdir()):
        raise OtherRunError(f"{out} is not empty and holds no comparison.")
    make_folder(out)
    svgs = {
        name: as_svg(name, partial(make, comparison.entrants, comparison.rows))
        for name, make in figures.FIGURES.items()
    }
    write(out / DOCUMENT, document(comparison))
    for name, content in (
        ("table.md", markdown(comparison)),
        ("table.csv", csv_text(comparison)),
        ("table.tex", latex(comparison)),
        *((f"figures/{name}.svg", svg) for name, svg in svgs.items()),
        (PAGE, page(comparison, svgs)),
    ):
        write(out / name, content)
    return out / PAGE
