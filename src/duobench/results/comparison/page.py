"""The page of a comparison: one HTML file that loads nothing."""

from __future__ import annotations

from collections.abc import Mapping

from markupsafe import Markup

from duobench.pages import render
from duobench.results.comparison import text, words
from duobench.results.comparison.comparison import Comparison
from duobench.results.comparison.entrants import Group
from duobench.results.comparison.paper import paper_results
from duobench.results.comparison.rows import Kind, sections
from duobench.results.comparison.tables import caption
from duobench.results.figures import for_page


def page(comparison: Comparison, svgs: Mapping[str, str]) -> str:
    """The page as HTML text.

    Args:
        comparison: What it shows.
        svgs: The figures, by name, as documents.
    """
    return render(
        "duobench.results",
        "comparison.html.j2",
        comparison=comparison,
        runs=[one for one in comparison.entrants if one.run],
        quoted=[one for one in comparison.entrants if not one.run],
        source=paper_results().source,
        sections=sections(comparison.rows),
        caption=caption(comparison),
        svgs={name: Markup(for_page(svg)) for name, svg in svgs.items()},
        Group=Group,
        Kind=Kind,
        text=text,
        words=words,
    )
