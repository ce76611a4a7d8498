"""Comparing runs: the paper's table, tests, figures and one page, computed from records alone.

No file written here depends on a clock, a folder or an order of records: the same runs in the same
order give the same bytes.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path

from duobench.results import figures, tables
from duobench.results.entrants import (
    Checker,
    Entrant,
    Group,
    RowKind,
    entrant_of,
    lettered,
    read_entrants,
    sections,
    sources_of,
    table_rows,
)
from duobench.results.pages import (
    PAGE,
    check_free,
    page,
    with_figures,
    write_files,
)
from duobench.results.pairs import RunComparison, compare_pair
from duobench.results.scores import RunPart

DOCUMENT = "comparison.json"
"""The comparison for programs; a folder that has it holds a comparison."""


def compare(sources: Sequence[str], checker: Checker | None = None) -> RunComparison:
    """Compare runs, any two of them; see `read_entrants` for both arguments. Nothing is written."""
    return compare_entrants(read_entrants(sources, checker))


def compare_parts(parts: Iterable[RunPart]) -> RunComparison:
    """Compare what was played under several conditions, such as those of one run."""
    return compare_entrants(lettered([entrant_of(part) for part in parts]))


def compare_entrants(entrants: Sequence[Entrant]) -> RunComparison:
    """Compare entrants that have their letters, any two of them."""
    rows = table_rows(entrants)
    pairs = [compare_pair(a, b, rows) for a, b in combinations(entrants, 2)]
    tested = sorted(
        (pair for pair in pairs if pair), key=lambda pair: pair.crosses_groups
    )
    return RunComparison(entrants=tuple(entrants), rows=rows, pairs=tuple(tested))


def write_comparison(comparison: RunComparison, out: Path) -> Path:
    """Write the files of a comparison into a folder, and return the page.

    The folder is made; an earlier comparison in it is replaced.
    """
    check_free(out, DOCUMENT, "comparison")
    return write_files(out, comparison_files(comparison))


def comparison_files(comparison: RunComparison) -> dict[str, str]:
    """Figures, tables, JSON form and page of a comparison, as text by name."""
    svgs = _figures(comparison)
    text = page(
        "comparison.html.j2",
        svgs,
        comparison=comparison,
        runs=[one for one in comparison.entrants if one.part],
        quoted=[one for one in comparison.entrants if not one.part],
        source=tables.listed(sources_of(comparison.entrants) or [""]),
        sections=sections(comparison.rows),
        caption=tables.caption(comparison),
        Group=Group,
        RowKind=RowKind,
        text=tables,
    )
    contents = {
        DOCUMENT: tables.comparison_json(comparison),
        "table.md": tables.markdown(comparison),
        "table.csv": tables.csv_text(tables.csv_rows(comparison)),
        "table.tex": tables.latex(comparison),
        PAGE: text,
    }
    return with_figures(contents, svgs)


def _figures(comparison: RunComparison) -> dict[str, str]:
    tasks = [row.tasks[0] for row in comparison.rows if row.kind is RowKind.TASK]
    reached = {
        one.key: {task.id: result for task in tasks if (result := one.result(task.id))}
        for one in comparison.entrants
    }
    bars = [
        (
            task.title,
            [(key, ours[task.id]) for key, ours in reached.items() if task.id in ours],
        )
        for task in tasks
    ]
    curves = [
        (f"{one.key}  {one.title}", reached[one.key])
        for one in comparison.entrants
        if one.part
    ]
    return {
        "stages": figures.as_svg("stages", figures.grouped_stage_bars, bars),
        "progress": figures.as_svg(
            "progress", figures.overlaid_progress, tasks, curves
        ),
    }
