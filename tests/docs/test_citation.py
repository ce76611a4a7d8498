"""CITATION.cff, README.md and CONTRIBUTING.md agree with each other and with the package."""

import re

import duobench
from tests.docs.markdown import ROOT, tables, text_of

CITATION, README, CONTRIBUTING = (
    ROOT / name for name in ("CITATION.cff", "README.md", "CONTRIBUTING.md")
)
UMLAUT = '{\\"u}'


def test_the_citation_is_of_this_version() -> None:
    assert f"\nversion: {duobench.__version__}\n" in text_of(CITATION)


def test_both_citations_name_the_same_authors_title_and_year() -> None:
    citation, readme = text_of(CITATION), text_of(README)
    names = re.findall(r"family-names: (.*)\n +given-names: (.*)\n", citation)
    (authors,) = re.findall(r"author = \{(.*?)\},\n", readme, flags=re.DOTALL)
    written = re.sub(r"\s+", " ", authors.replace(UMLAUT, "ü")).split(" and ")
    assert written == [", ".join(name) for name in names]
    (title,) = re.findall(r"title  = \{(.*?)\},\n", readme, flags=re.DOTALL)
    assert re.sub(r"\s+", " ", title.replace("{", "").replace("}", "")) in citation
    (year,) = re.findall(r"year   = \{(\d+)\}", readme)
    assert f"  year: {year}\n" in citation


def test_contributing_names_rooms_that_are_there() -> None:
    named = re.findall(r"`((?:duobench|dev|docs|examples|tests)/[^\s`]*)`", text_of(CONTRIBUTING))
    assert len(named) > 40
    rooms = [name if not name.startswith("duobench/") else f"src/{name}" for name in named]
    assert [room for room in rooms if not any(ROOT.glob(room))] == []


def test_contributing_has_one_room_for_each_change() -> None:
    (rows,) = (rows for rows in tables(CONTRIBUTING) if "X" in rows[0])
    names = [row["X"] for row in rows]
    assert len(names) == len(set(names))
    assert [row["X"] for row in rows if "/" not in row["where"]] == []


def test_contributing_names_every_verb_of_make() -> None:
    verbs = re.findall(r"^([a-z-]+):.* ## ", text_of(ROOT / "Makefile"), flags=re.MULTILINE)
    assert verbs
    rows = [row for rows in tables(CONTRIBUTING) for row in rows if "verb" in row]
    listed = [row["verb"].removeprefix("make ") for row in rows]
    listed.remove("test-NAME")  # stands for those of the second table
    assert sorted(listed) == sorted(verb for verb in verbs if verb != "help")
