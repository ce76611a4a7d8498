"""Cards of data sets: what the Hub reads, and what people do, follow from what is there."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest
from PIL import Image

from duobench.core.errors import DataError, OptionError
from duobench.core.randomness import SUITE_VERSION
from duobench.data import DataSet, export_lerobot, merge
from duobench.data.card import PICTURES, write_data_card
from duobench.data.lerobot.options import ExportOptions
from duobench.policy.training.training import plan_all

NAME = "us/demos"


def facts(card: Path) -> dict[str, Any]:
    """The front of a card: between two lines of dashes, a name and a value a line."""
    front = re.fullmatch(r"---\n(.*?)\n---\n.*", card.read_text(encoding="utf-8"), re.DOTALL)
    assert front is not None
    lines = [line.partition(": ") for line in front[1].splitlines()]
    return {name: json.loads(value) for name, _, value in lines}


@pytest.fixture
def demos(tmp_path: Path, demonstrations: Callable[..., Path]) -> Path:
    return copytree(demonstrations("bin_sort"), tmp_path / "demos")


def test_card_of_recordings_says_what_is_in_them(demos: Path) -> None:
    card = write_data_card(demos, NAME, "cc-by-4.0")
    text, told = card.read_text(encoding="utf-8"), facts(card)
    assert card == demos / "README.md"
    assert told["license"] == "cc-by-4.0"
    assert sorted(demos.glob(told["configs"][0]["data_files"])) == DataSet.open(demos).episodes()
    frames = sum(map(len, DataSet.open(demos).recordings()))
    assert f"| `bin_sort` | 1 | {frames} | {frames / 30:.0f} |" in text
    assert f"suite {SUITE_VERSION}; " in text
    assert "1 of 1 episodes succeeded, and 0 have a layout" in text
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
    assert f"| `bin_sort` | 1 | {done.frames} | " in text
    assert "`observation.state`" in text
    assert "![" not in text
    (out / PICTURES).mkdir()
    (out / PICTURES / "bin_sort.jpg").write_bytes(b"of the recordings")
    assert "![bin_sort](pictures/bin_sort.jpg)" in write_data_card(out, NAME, "mit").read_text()


@pytest.fixture
def two_tasks(demos: Path, tmp_path: Path, demonstrations: Callable[..., Path]) -> DataSet:
    other = DataSet.open(demonstrations("carry_pot", variety="none"))
    merge([DataSet.open(demos), other], tmp_path / "two")
    return DataSet.open(tmp_path / "two")


def loaded(card: Path) -> dict[str, list[Path]]:
    """The files of each table that the Hub loads by a card."""
    configs = facts(card)["configs"]
    return {one["config_name"]: sorted(card.parent.glob(one["data_files"])) for one in configs}


def test_recordings_of_a_task_are_a_table_for_the_hub(two_tasks: DataSet) -> None:
    """The state of each task has a length of its own."""
    found = loaded(write_data_card(two_tasks.path, NAME, "mit"))
    assert found == {task: two_tasks.episodes(task) for task in ("bin_sort", "carry_pot")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "per_task", "learns"),
    [
        ({}, False, ["--data", "data", "--tasks", "bin_sort"]),
        pytest.param({}, True, ["--data", "data/bin_sort"], marks=pytest.mark.long),
        pytest.param({"tasks": ("bin_sort",)}, False, ["--data", "data"], marks=pytest.mark.long),
        pytest.param(
            {"cameras": (), "object_state": True},
            True,
            ["--data", "data/bin_sort"],
            marks=pytest.mark.long,
        ),
        pytest.param({"cameras": ()}, False, None, marks=pytest.mark.long),
        pytest.param({"format": "v2.1"}, False, None, marks=pytest.mark.long),
        pytest.param({"every": 3, "codec": "h264"}, False, None, marks=pytest.mark.long),
        pytest.param({"state": ("joint_velocity",)}, False, None, marks=pytest.mark.long),
    ],
)
def test_an_export_is_loaded_and_trained_as_its_card_says(
    two_tasks: DataSet,
    tmp_path: Path,
    changes: dict[str, Any],
    per_task: bool,
    learns: list[str] | None,
) -> None:
    given = {"cameras": ("head",), "size": (16, 16)} | changes
    choice = given.pop("tasks", ())
    options = ExportOptions(**given, tasks=choice)
    export_lerobot(two_tasks, tmp_path / "data", options, per_task=per_task)
    card = write_data_card(tmp_path / "data", NAME, "mit")
    found = loaded(card)
    assert set(found) == ({"bin_sort", "carry_pot"} if per_task else {"default"})
    files = sorted(path for paths in found.values() for path in paths)
    rows = (path for path in (tmp_path / "data").rglob("*.parquet") if "meta" not in path.parts)
    assert files == sorted(rows) != []
    said = re.findall(r"^duobench train act (.*) --out runs/act$", card.read_text(), re.MULTILINE)
    assert said == ([] if learns is None else [" ".join(learns)])
    if learns is None:
        with pytest.raises(DataError):
            plan_all("act", tmp_path / "data", tmp_path / "out")
    else:
        assert len(plan_all("act", tmp_path / learns[1], tmp_path / "out", tasks=learns[3:])) == 1


def test_exports_of_one_task_are_one_task(two_tasks: DataSet, tmp_path: Path) -> None:
    for name in ("a", "b"):
        options = ExportOptions(cameras=(), tasks=("bin_sort",))
        done = export_lerobot(two_tasks, tmp_path / "data" / name, options)
    (tmp_path / "data/.cache/c/meta").mkdir(parents=True)  # what a download leaves is not shown
    (tmp_path / "data/.cache/c/meta/info.json").write_text("{}")
    text = write_data_card(tmp_path / "data", NAME, "mit").read_text(encoding="utf-8")
    assert "in 1 task of DuoBench" in text
    assert f"| `bin_sort` | 2 | {2 * done.frames} | " in text
    beside = tmp_path / "data" / "b" / "meta/duobench.json"
    beside.write_text(beside.read_text().replace(f'"{SUITE_VERSION}"', '"0"'))
    with pytest.raises(DataError, match=f"has exports of suites {SUITE_VERSION} and 0"):
        write_data_card(tmp_path / "data", NAME, "mit")


@pytest.mark.parametrize(
    ("name", "licence", "said"),
    [
        ("", "mit", "A name on the Hub"),
        ("-x", "mit", "A name on the Hub"),
        ('me/a & "b"', "mit", "A name on the Hub"),
        ("me/a/b", "mit", "A name on the Hub"),
        ("me/x-", "mit", "A name on the Hub"),
        ("me/a--b", "mit", "A name on the Hub"),
        ("me/x.git", "mit", "A name on the Hub"),
        (f"me/{'x' * 94}", "mit", "A name on the Hub"),
        (NAME, "", "The Hub knows licences"),
        (NAME, "MIT", "The Hub knows licences"),
        (NAME, "mit\ntags: x", "The Hub knows licences"),
    ],
)
def test_what_the_hub_would_refuse_is_refused(
    tmp_path: Path, name: str, licence: str, said: str
) -> None:
    with pytest.raises(OptionError, match=said):
        write_data_card(tmp_path, name, licence)


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
