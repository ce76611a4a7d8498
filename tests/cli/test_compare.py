import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Told, refusal
from tests.results.outcomes import play


@pytest.fixture
def runs(tmp_path: Path) -> tuple[str, str]:
    return (
        play(tmp_path / "new", {"sort": [3] * 12}, "new"),
        play(tmp_path / "old", {"sort": [1] * 12}, "old"),
    )


def test_it_says_who_is_better_and_where_the_page_is(
    runs: tuple[str, str], tmp_path: Path, told: Told
) -> None:
    out = told("compare", *runs, "paper:ACT", "--out", tmp_path / "both")
    assert "new is better than old in Sort: 12 of 12 episodes against 0 of 12" in out
    assert f"Comparison: {tmp_path / 'both' / 'index.html'}" in out
    assert (tmp_path / "both" / "index.html").is_file()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("{0} {1} --out {0}", "holds no comparison. Give --out another folder."),
        ("{0} {0}x --out out", "There is no folder {0}x. Beside it there are:"),
        ("{0} paper:AKT --out out", "Did you mean 'paper:ACT'"),
        ("{0} --out out", "A comparison takes 2 to 26 runs, got 1."),
    ],
)
def test_what_cannot_be_compared_is_told(words: str, message: str, runs: tuple[str, str]) -> None:
    assert message.format(*runs) in refusal("compare", *words.format(*runs).split())


def test_other_verbs_do_without_scipy() -> None:
    code = (
        "import sys, duobench.cli.program, duobench.results.report; print('scipy' in sys.modules)"
    )
    command = [sys.executable, "-c", code]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == "False\n"
