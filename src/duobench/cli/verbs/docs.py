"""The pages of documentation, without a network: `duobench docs`."""

from pathlib import Path

import tyro

from duobench.cli.shared.console import console, say, table, whole
from duobench.core.errors import DuoBenchError, check_known

DRAWERS = {
    "start": "install, a first evaluation, a first policy, a first task",
    "tasks": "what the tasks are, score, show and print",
    "guides": "how something is done, from an environment to real arms",
    "reference": "frames, results, baselines",
}
"""Folders of pages, in the order in which they are read, and what is in them."""
INSTALLED = Path(__file__).parents[2] / "docs"
CLONED = INSTALLED.parents[2] / "docs"
"""Where a wheel and a clone have their pages."""


def docs(name: tyro.conf.Positional[str] = "") -> None:
    """Show a page of documentation as Markdown, or name all pages.

    Args:
        name: A page, such as policies; all are listed if none is named.
    """
    found = pages()
    if name:
        # A link of another page, such as ../guides/scale.md#containers, is one too.
        name = Path(name.partition("#")[0]).stem
        check_known("page", name, found)
        console().out(found[name].read_text(encoding="utf-8"), end="")
        return
    rows = table(whole("Page"), "Heading")
    for drawer, about in DRAWERS.items():
        rows.add_section()
        rows.add_row(drawer.capitalize(), about, style="bold")
        for page in (page for page in found.values() if page.parent.name == drawer):
            rows.add_row(page.stem, title(page))
    say(rows)
    say("duobench docs PAGE shows one.")


def pages() -> dict[str, Path]:
    """Return the pages by name, in the order of the drawers.

    Raises:
        DuoBenchError: They are not where an installation or a clone has them.
    """
    for folder in (INSTALLED, CLONED):
        found = [page for drawer in DRAWERS for page in sorted((folder / drawer).glob("*.md"))]
        if found:
            return {page.stem: page for page in found}
    raise DuoBenchError(
        f"There are no pages in {INSTALLED}; a wheel of DuoBench has them, and so has a clone of "
        "its repository that was installed in place."
    )


def title(page: Path) -> str:
    """Return the heading of a page, without marks of code."""
    with page.open(encoding="utf-8") as lines:
        return next(lines).removeprefix("# ").strip().replace("`", "")
