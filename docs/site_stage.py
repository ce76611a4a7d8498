"""Lay out what Sphinx reads: the pages, those that follow from code, pictures and replays.

The pages link each other as files of the repository, which is how a code host shows them. Here
each link leads to the page of the site; a file that is no page is copied and can be downloaded.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

from site_outline import DRAWERS, KEYWORDS, UNTRIED, pages
from site_reference import REFERENCE
from site_tasks import task_page

from duobench.tasks import catalog

DOCS = Path(__file__).parent
ROOT = DOCS.parent
FIRST = ROOT / "README.md"
BESIDE = {
    "contributing": ROOT / "CONTRIBUTING.md",
    "security": ROOT / "SECURITY.md",
    "changelog": ROOT / "CHANGELOG.md",
    "conduct": ROOT / "CODE_OF_CONDUCT.md",
    "notices": ROOT / "THIRD_PARTY_NOTICES.md",
}
"""Pages of the drawer `project`."""
LINK = re.compile(r"(!?)\[((?:[^][]|\[[^]]*\])*)\]\(([^)\s]+)\)")
FENCED = re.compile(r"(^```.*?^```$)", flags=re.DOTALL | re.MULTILINE)
FILES = "files"
"""Folder of files that can be downloaded."""
QUESTIONS = {
    "How do I add a task of my own?": "start/add_a_task",
    "How do I evaluate a policy of my own?": "start/policies",
    "Which of two policies is better?": "guides/comparison",
    "How do I record demonstrations?": "guides/recording",
    "Where does something live in the code?": "project/contributing",
    "How can I take part?": "project/index",
}
"""What people come with, and the page that answers."""
NOT_TRIED = """
```{warning}
**Untried on hardware.** Nothing of this chapter was tried on a real arm, gripper, camera or
headset: it was tested against simulators and imitated devices alone.
```
"""


def stage(source: Path, extra: Path) -> None:
    """Fill two folders: what Sphinx reads, and what it copies as it is."""
    for folder in (source, extra):
        shutil.rmtree(folder, ignore_errors=True)
    places = sources()
    for name, content in generated():
        write(source / name, content)
    for path, place in places.items():
        text = moved(path.read_text(encoding="utf-8"), path, place, places, source)
        write(source / place, keywords(place.stem) + dressed(text, place))
    for folder in ("gallery", "looks", "printing"):
        shutil.copytree(
            DOCS / "tasks" / folder, source / "tasks" / folder, dirs_exist_ok=True
        )
    shutil.copytree(DOCS / "tasks" / "replays", extra / "tasks" / "replays")


def sources() -> dict[Path, Path]:
    """Return where each page of the repository is on the site, from its first page.

    Raises:
        ValueError: The outline lacks a page, or names one that there is not.
    """
    found = {page.stem: page for page in DOCS.glob("*/*.md")} | BESIDE
    made = {*catalog.names(), *REFERENCE}
    named = [name for drawer in DRAWERS for name in pages(drawer)]
    if sorted(named) != sorted([*found, *made]):
        odd = {*named}.symmetric_difference({*found, *made})
        raise ValueError(
            f"site_outline.py and docs/ differ in {', '.join(sorted(odd))}"
        )
    places = {
        found[name]: Path(drawer) / f"{name}.md"
        for drawer in DRAWERS
        for name in pages(drawer)
        if name in found
    }
    return {FIRST: Path("index.md"), **places}


def moved(
    text: str, path: Path, place: Path, places: Mapping[Path, Path], source: Path
) -> str:
    """Return a page whose links lead to the site's pages; files that it links are copied."""

    def lead(found: re.Match[str]) -> str:
        picture, words, target = found.groups()
        file, mark, anchor = target.partition("#")
        if "://" in target or target.startswith("mailto:") or not file:
            return found[0]
        named = Path(os.path.normpath(path.parent / file))
        if not named.exists():
            raise ValueError(
                f"{path.relative_to(ROOT)} links {target}, which is not there"
            )
        if named in places:
            new = os.path.relpath(places[named], place.parent)
            return f"{picture}[{words}]({new}{mark}{anchor})"
        if (
            named.suffix == ".html"
        ):  # a page of its own, which is shown and not downloaded
            at = os.path.relpath(named.relative_to(DOCS), place.parent)
            return f'<a href="{at}">{words}</a>'
        if named.is_dir():
            return words
        kept = named.relative_to(DOCS if DOCS in named.parents else ROOT)
        kept = kept if picture else FILES / kept if kept.parts[0] != "tasks" else kept
        (source / kept).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(named, source / kept)
        return f"{picture}[{words}]({os.path.relpath(kept, place.parent)})"

    parts = FENCED.split(text)
    parts[::2] = [LINK.sub(lead, part) for part in parts[::2]]
    return "".join(parts)


def dressed(text: str, place: Path) -> str:
    """Return a page with what the site adds to it."""
    name = place.stem
    if place == Path("index.md"):
        before, mark, after = text.partition("\n## ")
        return f"{before}\n{doors()}{mark}{after}\n{trees()}"
    if name in DRAWERS["guides"].chapters[UNTRIED]:
        heading, _, rest = text.partition("\n")
        return f"{heading}\n{NOT_TRIED}{rest}"
    return text


def keywords(name: str) -> str:
    """What a page begins with, so that it is found by words that do not stand in it."""
    words = ", ".join(KEYWORDS.get(name, "").split())
    return f"---\nmyst:\n  html_meta:\n    keywords: {words}\n---\n\n" if words else ""


def doors() -> str:
    """What the first page shows below its picture: the drawers, and the first questions."""
    cards = [
        f":::{{grid-item-card}} {drawer.title}\n:link: {folder}/index\n:link-type: doc\n\n"
        f"{drawer.about}\n:::\n"
        for folder, drawer in DRAWERS.items()
        if folder != "project"
    ]
    asked = [f"- [{question}]({page}.md)" for question, page in QUESTIONS.items()]
    grid = "".join(["::::{grid} 1 2 2 4\n:gutter: 3\n\n", *cards, "::::\n"])
    return "\n".join([grid, *asked, ""])


def trees() -> str:
    """Return the table of contents of the first page, which the side shows."""
    lines = "\n".join(
        f"{drawer.title} <{folder}/index>" for folder, drawer in DRAWERS.items()
    )
    return f"\n```{{toctree}}\n:hidden:\n\n{lines}\n```\n"


def generated() -> Iterator[tuple[Path, str]]:
    """Give the pages that follow from code, and the first page of each drawer."""
    for folder in DRAWERS:
        yield Path(folder) / "index.md", drawer_page(folder)
    for name in catalog.names():
        yield Path("tasks") / f"{name}.md", task_page(catalog.get(name))
    for name, make in REFERENCE.items():
        yield Path("reference") / f"{name}.md", make()


def drawer_page(folder: str) -> str:
    """Return the first page of a drawer: its pages by chapter."""
    drawer = DRAWERS[folder]
    lines = [f"# {drawer.title}", "", drawer.about, ""]
    for heading, names in drawer.chapters.items():
        if heading:
            lines += [f"## {heading}", ""]
        if heading == UNTRIED:
            lines.append(NOT_TRIED)
        if set(names) <= set(catalog.names()):
            lines.append(cards(names))
            listed = [":hidden:", "", *names]
        else:
            listed = [":maxdepth: 1", "", *names]
        lines += ["```{toctree}", *listed, "```", ""]
    return "\n".join(lines)


def cards(names: tuple[str, ...]) -> str:
    """Return a picture of each task, which leads to its page."""
    lines = ["::::{grid} 2 2 3 4", ":gutter: 2", ""]
    for name in names:
        task = catalog.get(name)
        lines += [
            f":::{{grid-item-card}} {task.title}",
            f":link: {name}",
            ":link-type: doc",
            f":img-top: gallery/{name}/overview.jpg",
            f":img-alt: {task.title} at the start of an episode",
            "",
            str(task.category).capitalize(),
            ":::",
        ]
    return "\n".join([*lines, "::::", ""])


def write(path: Path, text: str) -> None:
    """Write a page, with its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
