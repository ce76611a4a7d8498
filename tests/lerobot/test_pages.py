"""The pages on LeRobot and on Parquet: what they print runs, in an environment with LeRobot."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from tests.docs.markdown import page_of
from tests.lerobot.tools import TINY, run


def blocks(page: str, language: str) -> list[str]:
    text = page_of(page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def shell(line: str, folder: Path) -> str:
    words = shlex.split(line.replace("\\\n", " "))
    if words[0] == "duobench":
        words = [sys.executable, "-P", "-m", *words]
    elif words[0] == "lerobot-train":
        words += [*TINY, "--policy.pretrained_backbone_weights=null", "--steps=1"]
    return run(words, folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the first commands of the page on LeRobot have run."""
    folder = tmp_path_factory.mktemp("page")
    for line in blocks("lerobot", "sh")[0].splitlines():
        shell(line, folder)
    return folder


@pytest.mark.parametrize("line", blocks("lerobot", "sh")[1:])
def test_command_of_the_page_runs(line: str, folder: Path) -> None:
    shell(line, folder)


@pytest.mark.parametrize("code", [*blocks("lerobot", "python"), *blocks("parquet", "python")])
def test_code_of_the_pages_runs(code: str, folder: Path) -> None:
    assert run([sys.executable, "-c", code], folder)
