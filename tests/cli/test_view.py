"""What `duobench view` says where there is nothing to see."""

import sys
from pathlib import Path

import pytest

from tests.cli.conftest import refusal


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("carry_pto", "Did you mean 'carry_pot'"),
        ("somewhere/else", "Unknown task 'somewhere/else'"),
        ("folder", "holds neither a data set (dataset.json) nor an evaluation (run.json)"),
        ("file.zip", "file.zip"),
        ("carry_pot --look drak", "Did you mean 'dark'"),
        ("carry_pot --port 70000", "Cannot listen at 127.0.0.1:70000"),
        ("carry_pot --lan", "pip install 'duobench-fr3[teleop]'"),
        ("--prot 3", "Did you mean --port"),
    ],
)
def test_mistake_is_told_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, message: str
) -> None:
    monkeypatch.setitem(sys.modules, "trustme", None)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "file.zip").write_bytes(b"none")
    assert message in refusal("view", *words.split())
