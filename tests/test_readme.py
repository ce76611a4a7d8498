"""What README.md says works: its code, its commands and its table, in the order of the page.

Commands of `make` are left out: they make an environment of their own and `make test` is what runs
this file. So is what installs packages.
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from docs.table import with_table

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"


def blocks(language: str) -> list[str]:
    text = README.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def modules() -> dict[str, str]:
    """The blocks that the text before them names as a file, such as `my_policy.py`."""
    text = README.read_text(encoding="utf-8")
    return dict(re.findall(r"`(\w+\.py)`[^`]*```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE))


def shell_lines() -> list[list[str]]:
    return [
        words
        for block in blocks("sh")
        for line in block.splitlines()
        if (words := shlex.split(line, comments=True))
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the commands run, one after another, as a reader would run them."""
    folder = tmp_path_factory.mktemp("readme")
    for name, code in modules().items():
        (folder / name).write_text(code, encoding="utf-8")
    return folder


def run(command: list[str], folder: Path) -> str:
    result = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_every_kind_of_block_is_known() -> None:
    text = README.read_text(encoding="utf-8")
    assert set(re.findall(r"^```(\w+)$", text, flags=re.MULTILINE)) == {"sh", "python", "bibtex"}
    assert {words[0] for words in shell_lines()} == {"make", "duobench"}


def test_policy_of_the_page_is_short() -> None:
    assert len(modules()["my_policy.py"].splitlines()) < 15


@pytest.mark.parametrize(
    "code", [code for code in blocks("python") if code not in modules().values()]
)
def test_code_runs(code: str, folder: Path) -> None:
    assert run([sys.executable, "-c", code], folder)


@pytest.mark.parametrize("line", [words for words in shell_lines() if words[0] == "duobench"])
def test_command_runs(line: list[str], folder: Path) -> None:
    script = Path(sys.executable).with_name("duobench")
    assert run([str(script), *line[1:]], folder)


def test_verbs_of_make_exist() -> None:
    text = README.read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    verbs = set(re.findall(r"`make (\w+)`|^make (\w+)", text, flags=re.MULTILINE))
    assert verbs
    for verb in {first or second for first, second in verbs}:
        assert re.search(rf"^{verb}:", makefile, flags=re.MULTILINE), verb


def test_table_of_tasks_is_that_of_the_catalog() -> None:
    text = README.read_text(encoding="utf-8")
    assert with_table(text) == text, "run: make docs"


def test_links_into_the_repository_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)]+)\)", README.read_text(encoding="utf-8"))
    assert links
    assert [link for link in links if "://" not in link and not (ROOT / link).exists()] == []
