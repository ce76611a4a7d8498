"""The page on viewing: its commands run, and whoever opens the addresses that they print sees."""

import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from duobench.replay.sources import LAYOUTS
from duobench.replay.viewer import MAX_ITEMS
from duobench.web.messages import MAX_MESSAGE
from duobench.web.server import MAX_PEERS
from tests.docs.markdown import DOCS, blocks, text_of
from tests.web.pages import open_page

PAGE = DOCS / "viewing.md"
TIMEOUT_S = 120


def look(line: str, folder: Path) -> list[dict[str, Any]]:
    """Run a command, and look at its page until an episode is shown, or the report of a run."""
    last = "report" if "--watch" in line else "instruction"
    command = [sys.executable, "-P", "-m", *shlex.split(line)]
    seen: list[dict[str, Any]] = []
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            address = next(each for each in process.stdout if "http://" in each)
            with open_page(address.split()[-1]) as page:
                while not (seen and seen[-1].get(last)):
                    seen.append(page.hear_of("status"))
            if last != "report":
                process.send_signal(signal.SIGINT)
            process.communicate(timeout=TIMEOUT_S)
        finally:
            process.kill()
    assert process.returncode == 0
    return seen


@pytest.mark.slow
def test_commands_run(tmp_path: Path) -> None:
    (commands,) = blocks(PAGE, "sh")
    shown = {}
    for line in commands.splitlines():
        if " view " in line or "--watch" in line:
            shown[line.split()[-1]] = look(line, tmp_path)[-1]
            continue
        command = [sys.executable, "-P", "-m", *shlex.split(line)]
        subprocess.run(command, cwd=tmp_path, capture_output=True, check=True)
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
