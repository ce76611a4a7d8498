"""The site as it is built: whole, small, of use without a network, and quick to find things in."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from duobench.cli.program import COMMANDS
from duobench.tasks import catalog
from tests.docs.markdown import DOCS, ROOT, blocks
from tests.site.html_page import SITE, read
from tests.test_surface import SURFACE

MAX_BYTES = 25_000_000
PAGES = sorted(SITE.rglob("*.html"))
WRITTEN = [page for page in PAGES if page.parent.name != "replays" and page.name != "search.html"]
FIRST = SITE / "index.html"
ELSEWHERE = ("http:", "https:", "//", "mailto:")


def test_it_is_whole_and_small() -> None:
    built = {page.stem for page in PAGES}
    assert {page.stem for page in DOCS.rglob("*.md")} <= built
    assert set(catalog.names()) <= built
    assert sum(file.stat().st_size for file in SITE.rglob("*") if file.is_file()) < MAX_BYTES


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: str(page.relative_to(SITE)))
def test_every_link_leads_to_a_file_and_to_what_it_names_there(page: Path) -> None:
    whole = read(page)
    broken = []
    for link in whole.files:
        if link.startswith((*ELSEWHERE, "data:")):
            continue
        target, anchor = whole.leads_to(link), link.partition("#")[2]
        target = page if link.startswith("#") else target
        named = target.suffix != ".html" or not anchor or anchor in read(target).anchors
        if not (target.is_file() and named):
            broken.append(link)
    assert broken == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(SITE)))
def test_nothing_is_fetched_from_elsewhere(page: Path) -> None:
    """Styles, scripts, pictures and fonts; links may lead away."""
    text = page.read_text(encoding="utf-8")
    fetched = re.findall(r"<(?:link|script|img|iframe|source)\b[^>]*(?:href|src)=\"([^\"]+)", text)
    assert [each for each in fetched if each.startswith(ELSEWHERE)] == []


def test_styles_fetch_nothing_from_elsewhere() -> None:
    styles = list(SITE.rglob("*.css"))
    assert styles
    for style in styles:
        assert not re.search(r"url\(['\"]?(https?:)?//", style.read_text(encoding="utf-8")), style


# --- finding -------------------------------------------------------------------------------------

QUESTIONS = {
    "a task of my own": "stack_cube:TASK",
    "a policy of my own": "class MyPolicy",
    "compare two policies": "duobench compare",
    "record demonstrations": "duobench record --tasks",
    "where does X live": "Where do I put X",
}
"""What people ask, and what stands where the answer is."""


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_question_is_answered_one_click_from_the_first_page(question: str) -> None:
    linked = {read(FIRST).leads_to(link) for link in read(FIRST).links}
    pages = linked & set(WRITTEN) - {FIRST}
    assert any(QUESTIONS[question] in read(page).text for page in pages)


INDEX = json.loads(
    (SITE / "searchindex.js").read_text(encoding="utf-8").removeprefix("Search.setIndex(")[:-1]
)


@pytest.mark.parametrize(
    ("word", "page"),
    [
        ("torqu", "guides/real_arms"),
        ("parquet", "guides/parquet"),
        ("wilson", "guides/comparison"),
        ("libegl1", "start/install"),
        ("pour_marbl", "tasks/pour_marbles"),
        ("maco", "start/install"),
        ("headless", "start/install"),
        ("jupyt", "guides/environments"),
        ("effector", "reference/frames"),
        ("hug", "guides/publish"),
        ("bibtex", "index"),
        ("wandb", "guides/lerobot"),
        ("urdf", "reference/frames"),
        ("licens", "index"),
        ("color", "tasks/looks"),
    ],
)
def test_the_search_knows_words_by_their_stems(word: str, page: str) -> None:
    found = INDEX["terms"].get(word, [])
    names = [INDEX["docnames"][at] for at in (found if isinstance(found, list) else [found])]
    assert page in names


def test_the_search_knows_every_page_and_loads_as_a_file() -> None:
    """A script is loaded from a disk as well, where a browser refuses to fetch."""
    known = {SITE / f"{name}.html" for name in INDEX["docnames"]}
    assert known == set(WRITTEN) - {SITE / "genindex.html"}
    assert "searchindex.js" in (SITE / "search.html").read_text(encoding="utf-8")


# --- what follows from code ----------------------------------------------------------------------


def test_the_first_page_has_the_commands_and_the_policy_of_the_readme() -> None:
    shown = read(FIRST).text
    for language in ("sh", "python"):
        for block in blocks(ROOT / "README.md", language):
            assert block.strip() in shown


def test_python_has_every_public_name() -> None:
    anchors = read(SITE / "reference" / "python.html").anchors
    described = {anchor.rpartition(".")[2] for anchor in anchors}
    for names in SURFACE.values():
        assert {name for name in names.split() if name[0] != "_"} - described == set()


def test_the_command_line_has_every_command() -> None:
    text = read(SITE / "reference" / "command_line.html").text
    for words in COMMANDS:
        assert f"duobench {words}" in text


@pytest.mark.parametrize("name", ["command_line", "options", "schemas", "python"])
def test_code_is_shown_as_code(name: str) -> None:
    """A mark of it that is left over stands where something in it ended it, such as a bar."""
    assert "`" not in read(SITE / "reference" / f"{name}.html").text


def test_real_arms_begin_with_what_was_not_tried() -> None:
    for page in DOCS.rglob("real_*.md"):
        text = read(SITE / page.relative_to(DOCS).with_suffix(".html")).text
        assert "Untried on hardware" in text[:600]
