"""A folder that is not of the kind that a verb takes: what it is, and what would do."""

from pathlib import Path

import pytest

from duobench.data import DataSet
from tests.cli.conftest import Told, refusal


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with an empty data set and what looks like an evaluation, in which one works."""
    monkeypatch.chdir(tmp_path)
    DataSet.open("demos")
    run = tmp_path / "runs" / "x"
    run.mkdir(parents=True)
    (run / "run.json").write_text("{}")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("replay demoz", "There is no folder demoz. Beside it there are: demos."),
        ("report runs/y", "There is no folder runs/y. Beside it there are: runs/x."),
        ("report demos", "demos is a data set, not an evaluation. Try: duobench data info demos"),
        (
            "data info runs/x",
            "runs/x is an evaluation, not a data set. Try: duobench report runs/x",
        ),
        ("data split demos --out a b", "--fraction 0.8, or all of some tasks, such as --tasks"),
    ],
)
def test_it_says_what_would_do(words: str, message: str) -> None:
    assert message in refusal(*words.split())


def test_nothing_to_recover_is_said(told: Told) -> None:
    assert told("data", "recover", "demos") == "There is nothing to recover.\n"
