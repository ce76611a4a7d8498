"""The page on viewing: its commands run, and whoever opens the addresses that they print sees."""

from pathlib import Path
from typing import Any

import pytest

from duobench.replay.sources import LAYOUTS
from duobench.replay.viewer import MAX_ITEMS
from duobench.web.messages import MAX_MESSAGE
from duobench.web.server import MAX_PEERS
from tests.docs.markdown import DOCS, attend, blocks, run, text_of
from tests.web.pages import Page

PAGE = DOCS / "viewing.md"


def look(line: str, folder: Path) -> dict[str, Any]:
    """Run a command, and look at its page until an episode is shown, or the report of a run; the
    last status.
    """
    seen: list[dict[str, Any]] = []
    watched = "--watch" in line

    def until_shown(page: Page) -> None:
        while not (seen and seen[-1].get("report" if watched else "instruction")):
            seen.append(page.hear_of("status"))
        if not watched:
            page.frame()

    attend(line, folder, until_shown, end=not watched)
    return seen[-1]


@pytest.mark.slow
def test_commands_run(tmp_path: Path) -> None:
    (commands,) = blocks(PAGE, "sh")
    shown = {}
    for line in commands.splitlines():
        if " view " in line or "--watch" in line:
            shown[line.split()[-1]] = look(line, tmp_path)
        else:
            run(line, tmp_path)
    assert len(shown["carry_pot"]["items"]) == LAYOUTS
    assert len(shown["data/expert"]["items"]) == 2
    assert shown["data/expert"]["steps"] > 0
    assert shown["--watch"]["run"]["finished"] == 2
    assert [item["state"] for item in shown["runs/expert"]["items"]] == ["success"] * 2


def test_numbers_are_those_of_the_code() -> None:
    text = text_of(PAGE)
    assert f"any of {LAYOUTS} layouts" in text
    assert f"{MAX_MESSAGE:,} bytes" in text
    assert f"{MAX_PEERS} browsers" in text
    assert f"at most {MAX_ITEMS} episodes" in text
