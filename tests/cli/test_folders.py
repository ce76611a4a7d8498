"""A folder that is not of the kind that a verb takes: what it is, and what would do."""

import json
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.data import DataSet


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an empty data set and what looks like an evaluation, in which one works."""
    monkeypatch.chdir(tmp_path)
    DataSet.open("demos")
    run = tmp_path / "runs" / "x"
    run.mkdir(parents=True)
    (run / "run.json").write_text(json.dumps({}))
    return tmp_path


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
@pytest.mark.usefixtures("folder")
def test_it_says_what_would_do(words: str, message: str) -> None:
    with pytest.raises(SystemExit) as left:
        main(words.split())
    assert message in str(left.value.code)


@pytest.mark.usefixtures("folder")
def test_nothing_to_recover_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    main(["data", "recover", "demos"])
    assert capsys.readouterr().out == "There is nothing to recover.\n"
