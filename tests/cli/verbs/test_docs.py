"""`duobench docs`: the pages as text, in a clone and out of the wheel."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.cli.verbs import docs
from tests.docs.markdown import DOCS, page_of, text_of
from tests.test_repository import ROOT

MAX_BYTES = 500_000
"""Of all pages in the wheel, unpacked."""
PAGES = {page.stem: page for page in DOCS.rglob("*.md")}


def test_every_page_is_listed_with_its_heading(capsys: pytest.CaptureFixture[str]) -> None:
    main(["docs"])
    said = capsys.readouterr().out
    for name, page in PAGES.items():
        heading = text_of(page).partition("\n")[0].removeprefix("# ").replace("`", "")
        assert re.search(rf"^ {name} +{re.escape(heading)} *$", said, re.MULTILINE), name
    assert re.search("^ Reference +frames, results, baselines *$", said, re.MULTILINE)
    assert {page.stem for page in DOCS.glob("reference/*.md")} == {"frames", "results", "baselines"}


@pytest.mark.parametrize(
    "word", ["policies", "../start/policies.md", "docs/start/policies.md", "policies#what"]
)
def test_a_page_is_shown_as_it_is_written(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["docs", word])
    assert capsys.readouterr().out == text_of(page_of("policies"))


@pytest.mark.parametrize("word", ["polices", "no", "..", "/etc/passwd", "start"])
def test_an_unknown_page_is_an_error_that_knows_the_near_ones(word: str) -> None:
    with pytest.raises(SystemExit, match=r"Unknown page .*Known: add_a_task, "):
        main(["docs", word])


def test_a_misspelt_page_is_proposed() -> None:
    with pytest.raises(SystemExit, match="Did you mean 'frames'"):
        main(["docs", "frame"])


def test_an_installation_without_pages_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(docs, "INSTALLED", tmp_path)
    monkeypatch.setattr(docs, "CLONED", tmp_path)
    with pytest.raises(SystemExit, match=r"There are no pages in .*; a wheel of DuoBench"):
        main(["docs"])


def test_the_wheel_has_every_page_and_nothing_large(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = {
            Path(each.filename).stem: archive.read(each)
            for each in archive.infolist()
            if each.filename.startswith("duobench/docs/")
        }
    assert packed == {name: page.read_bytes() for name, page in PAGES.items()}
    assert sum(map(len, packed.values())) < MAX_BYTES


def test_the_code_names_pages_that_there_are() -> None:
    """What it says of them, in errors and in its help, is a command that works."""
    named = {
        (path.name, word)
        for path in (ROOT / "src").rglob("*.py")
        for word in re.findall(r"duobench docs ([a-z_]+)", path.read_text(encoding="utf-8"))
    }
    assert named
    assert {each for each in named if each[1] not in PAGES} == set()
