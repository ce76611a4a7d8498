"""Cards of data sets: what the Hub reads, and what people do, follow from what is there."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest
from PIL import Image

from duobench.data import DataSet, export_lerobot
from duobench.data.card import PICTURES, write_data_card
from duobench.data.lerobot.options import ExportOptions
from duobench.errors import DataError
from duobench.randomness import SUITE_VERSION

NAME = "us/demos"


def facts(card: Path) -> dict[str, Any]:
    """The front of a card: between two lines of dashes, a name and a value a line."""
    front = re.fullmatch(r"---\n(.*?)\n---\n.*", card.read_text(encoding="utf-8"), re.DOTALL)
    assert front is not None
    lines = [line.partition(": ") for line in front[1].splitlines()]
    return {name: json.loads(value) for name, _, value in lines}


@pytest.fixture
def demos(tmp_path: Path, demonstrations: Callable[..., Path]) -> Path:
    return copytree(demonstrations("bin_sort", episodes=2), tmp_path / "demos")


def test_card_of_recordings_says_what_is_in_them(demos: Path) -> None:
    card = write_data_card(demos, NAME, "cc-by-4.0")
    text, told = card.read_text(encoding="utf-8"), facts(card)
    assert card == demos / "README.md"
    assert told["license"] == "cc-by-4.0"
    assert sorted(demos.glob(told["configs"][0]["data_files"])) == DataSet.open(demos).episodes()
    frames = sum(map(len, DataSet.open(demos).recordings()))
    assert f"| `bin_sort` | 2 | {frames} | {frames / 30:.0f} |" in text
    assert f"suite {SUITE_VERSION}; " in text
    assert "2 of 2 episodes succeeded, and 0 have a layout" in text
    assert f"hf download {NAME} --repo-type dataset" in text
    (picture,) = re.findall(r"!\[bin_sort\]\((.*)\)", text)
    with Image.open(demos / picture) as image:
        assert image.width > image.height
    assert write_data_card(demos, NAME, "cc-by-4.0").read_text(encoding="utf-8") == text


@pytest.mark.parametrize(("cameras", "per_task"), [(("head",), False), ((), True)])
def test_card_of_an_export_says_what_it_has(
    demos: Path, tmp_path: Path, cameras: tuple[str, ...], per_task: bool
) -> None:
    out = tmp_path / "export"
    options = ExportOptions(cameras=cameras, size=(32, 32))
    done = export_lerobot(DataSet.open(demos), out, options, per_task=per_task)
    card = write_data_card(out, NAME, "apache-2.0")
    text = card.read_text(encoding="utf-8")
    assert "LeRobot" in facts(card)["tags"]
    assert f"| `bin_sort` | 2 | {done.frames} | " in text
    assert "`observation.state`" in text
    assert "![" not in text
    (out / PICTURES).mkdir()
    (out / PICTURES / "bin_sort.jpg").write_bytes(b"of the recordings")
    assert "![bin_sort](pictures/bin_sort.jpg)" in write_data_card(out, NAME, "mit").read_text()


@pytest.mark.parametrize(
    ("beside", "said"),
    [
        (None, "it has no meta/duobench.json"),
        ("[]", "it holds a list, no object"),
        ("{", "Cannot read .*duobench.json"),
        ("{}", "is no whole export .*KeyError"),
        ('{"suite_version": "1", "episodes": [3]}', "is no whole export"),
        ('{"suite_version": "1", "episodes": [{"file": 3}]}', "is no whole export"),
    ],
)
def test_card_of_an_export_of_others_is_refused(
    tmp_path: Path, beside: str | None, said: str
) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text("{}")
    if beside is not None:
        (tmp_path / "meta/duobench.json").write_text(beside)
    with pytest.raises(DataError, match=said):
        write_data_card(tmp_path, "me/x", "apache-2.0")
    assert not (tmp_path / "README.md").exists()


def test_card_of_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no data set"):
        write_data_card(tmp_path, NAME, "apache-2.0")
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta/info.json").write_text("{}")
    with pytest.raises(DataError, match="no export of DuoBench"):
        write_data_card(tmp_path, NAME, "apache-2.0")
