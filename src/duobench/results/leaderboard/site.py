"""The pages of a leaderboard: HTML files that load nothing, the same bytes for the same bundles."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from markupsafe import Markup

from duobench.errors import OtherRunError
from duobench.files import make_folder, write, writing
from duobench.pages import render
from duobench.results import figures, metrics
from duobench.results.bundle import BUNDLE_SUFFIX
from duobench.results.comparison.paper import WARNING, paper_results
from duobench.results.leaderboard.board import SHORT, Board, Entry
from duobench.results.leaderboard.document import document
from duobench.results.leaderboard.figures import shown, stages
from duobench.results.leaderboard.protocol import EPISODES
from duobench.results.metrics import Results
from duobench.results.reporting.identity import identity
from duobench.tasks import catalog
from duobench.tasks.task import Category

DOCUMENT = "leaderboard.json"
"""The leaderboard for programs; a folder that has it holds one."""
PAGE = "index.html"
"""The leaderboard for people."""
VERDICTS = "verification"
"""Folder of what is known about bundles that were verified before."""
_POLICIES = "policies"


def begin_site(out: Path) -> None:
    """Make the folder of a leaderboard, or find that it is one.

    Raises:
        OtherRunError: It holds something else.
        OutputError: It cannot be made.
    """
    is_ours = (out / DOCUMENT).exists() or (out / VERDICTS).is_dir()
    if not is_ours and out.is_dir() and any(out.iterdir()):
        raise OtherRunError(f"{out} is not empty and holds no leaderboard.")
    make_folder(out / VERDICTS)


def write_site(board: Board, out: Path) -> Path:
    """Write all pages and the JSON form; pages of bundles that are gone are removed.

    Args:
        board: What to show.
        out: The folder, after `begin_site`.

    Returns:
        The first page.

    Raises:
        OutputError: It cannot be written.
    """
    pages = {entry.page: _policy_page(board, entry) for entry in board.entries}
    for name, text in pages.items():
        write(out / name, text)
    write(out / PAGE, _front_page(board))
    write(out / DOCUMENT, document(board))
    for path in (out / _POLICIES).glob("*.html"):
        if f"{_POLICIES}/{path.name}" not in pages:
            with writing(path):
                path.unlink()
    return out / PAGE


def _front_page(board: Board) -> str:
    entries = shown(board)
    svg = figures.as_svg("leaderboard", partial(stages, entries)) if entries else ""
    return render(
        "duobench.results",
        "leaderboard.html.j2",
        board=board,
        groups=(
            ("Policies", board.ranked(privileged=False)),
            ("Privileged policies", board.ranked(privileged=True)),
        ),
        categories=[str(category) for category in Category],
        paper=paper_results(),
        warning=WARNING,
        shown=entries,
        stages=Markup(figures.for_page(svg)) if svg else "",
        number_of_tasks=len(catalog.names()),
        episodes=EPISODES,
        suffix=BUNDLE_SUFFIX,
        short=SHORT,
        metrics=metrics,
    )


def _policy_page(board: Board, entry: Entry) -> str:
    results: Results = entry.results
    svgs = {name: figures.plot(name, results) for name in figures.FIGURES}
    places = {
        one.entry.digest: one.rank
        for privileged in (False, True)
        for one in board.ranked(privileged=privileged)
    }
    return render(
        "duobench.results",
        "leaderboard_policy.html.j2",
        entry=entry,
        run=entry.run,
        rank=places.get(entry.digest),
        results=results,
        identity=identity(entry.run),
        svgs={name: Markup(figures.for_page(svg)) for name, svg in svgs.items()},
        expected=entry.run.suite.episodes if entry.lacks else EPISODES,
        control_rate_hz=1.0,
        figures=figures,
        metrics=metrics,
    )
