"""Reading the pages of documentation: their tables and their blocks of code."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.web.pages import Page, open_page

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.rglob("*.md"), *ROOT.glob("*.md")])

TIMEOUT_S = 300
TIMES = re.compile(r"\d+:\d\d(:\d\d)?|\d+(\.\d+)? s\b")
"""What differs from one run of a command to the next."""

Row = dict[str, str]


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def page_of(name: str) -> Path:
    """The page of a name, in whichever drawer of docs/ it lies.

    Raises:
        AssertionError: There is no such page, or more than one.
    """
    found = [page for page in DOCS.rglob("*.md") if page.stem == name]
    assert len(found) == 1, f"{name}: {len(found)} pages"
    return found[0]


def tables(page: Path) -> list[list[Row]]:
    """Every table of a page, as rows by heading, without backticks."""
    found = re.findall(r"(?:^\|.*\n)+", text_of(page), flags=re.MULTILINE)
    return [rows for block in found if (rows := _rows(block))]


def table(page: Path, first_heading: str) -> list[Row]:
    """The one table whose first column has this heading.

    Raises:
        AssertionError: There is no such table, or more than one.
    """
    found = [rows for rows in tables(page) if next(iter(rows[0])) == first_heading]
    assert len(found) == 1, f"{page.name}: {len(found)} tables begin with {first_heading!r}"
    return found[0]


def _rows(block: str) -> list[Row]:
    shown = re.sub(r"<!--.*?-->", "", block)
    heading, _, *lines = (
        [cell.strip() for cell in line.split("|")[1:-1]] for line in shown.splitlines()
    )
    rows = [[cell.replace("`", "") for cell in line] for line in lines]
    return [
        dict(zip((name.replace("`", "") for name in heading), row, strict=True)) for row in rows
    ]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text_of(page), flags=re.DOTALL | re.MULTILINE)


def modules(page: Path) -> dict[str, str]:
    """The blocks that the text before them names as a file, such as `my_policy.py`."""
    named = r"`(\w+\.py)`[^`]*```python\n(.*?)^```"
    return dict(re.findall(named, text_of(page), flags=re.DOTALL | re.MULTILINE))


def check_output(page: Path, line: str, said: str) -> None:
    """Compare what a command printed with the block below it, if there is one; times are masked.

    With the variable DUOBENCH_WRITE_PAGES, as `make docs` sets it, write it there instead.
    """
    text = text_of(page)
    block = rf"(```sh\n{re.escape(line)}\n```\n\n```text\n)(.*?)(^```)"
    if (shown := re.search(block, text, flags=re.DOTALL | re.MULTILINE)) is None:
        return
    masked = TIMES.sub("…", "".join(f"{each.rstrip()}\n" for each in said.splitlines()))
    if os.environ.get("DUOBENCH_WRITE_PAGES"):
        page.write_text(text[: shown.end(1)] + masked + text[shown.start(3) :], encoding="utf-8")
    else:
        assert masked == shown[2], "run: make docs"


def links(page: Path) -> list[str]:
    """Links into the repository, without what follows a `#`."""
    targets = re.findall(r"\]\(([^)]+)\)", text_of(page))
    return [target.partition("#")[0] for target in targets if "://" not in target]


def command(line: str) -> list[str]:
    # -P: the current folder is no more on the path than for the installed command.
    return [sys.executable, "-P", "-m", *shlex.split(line)]


def attend(line: str, folder: Path, attend: Callable[[Page], None], *, end: bool = False) -> str:
    """Run a command and do something at its page, at whose `end` it is interrupted; its output."""
    with subprocess.Popen(command(line), cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            address = next(each for each in process.stdout if "http://" in each)
            with open_page(address.split()[-1]) as page:
                attend(page)
            if end:
                process.send_signal(signal.SIGINT)
            said = process.communicate(timeout=TIMEOUT_S)[0]
        finally:
            process.kill()
    assert process.returncode == 0
    return said


def run(
    words: str | Sequence[str], folder: Path, answers: str = "", *, code: int = 0, **variables: str
) -> str:
    """Run a line of a page, or a program and what it is called with, in a folder; what it prints.

    It reads answers and ends with a code; variables are those of the environment.
    """
    result = subprocess.run(
        command(words) if isinstance(words, str) else words,
        cwd=folder,
        env={**os.environ, **variables},
        input=answers,
        check=False,
        capture_output=True,
        text=True,
    )
    assert result.returncode == code, result.stdout + result.stderr
    return result.stdout


def run_python(code: str, folder: Path) -> str:
    return run([sys.executable, "-P", "-c", code], folder)
