"""A random look for each episode of an export."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import DataError, OtherRunError, UnknownNameError
from duobench.data import DataSet, ImageSource, Recording
from duobench.data.arrange import merge
from duobench.data.lerobot.export import export_lerobot
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.lerobot.options import PER_EPISODE, ExportOptions
from duobench.world.looks.catalog import random_look
from tests.data.conftest import EPISODES
from tests.data.real.number_duo import SIZE
from tests.data.test_lerobot import MIN_PSNR_DB, files, frames
from tests.data.tools import TASK

OPTIONS = ExportOptions(size=(32, 48), cameras=("head",), look=PER_EPISODE)


def looks(folder: Path) -> list[str | None]:
    """The look of each episode, as the export says."""
    about = json.loads((folder / "meta/duobench.json").read_text())
    return [episode["look"] for episode in about["episodes"]]


def export(data: DataSet | list[DataSet], out: Path, **options: Any) -> list[str | None]:
    chosen = {"size": OPTIONS.size, "cameras": OPTIONS.cameras, "look": OPTIONS.look, **options}
    export_lerobot(data, out, ExportOptions(**chosen), workers=0)
    return looks(out)


@pytest.fixture(scope="module")
def exported(original: DataSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("looks") / "out"
    assert len({*export(original, out)}) == EPISODES
    return out


def test_an_episode_is_rendered_in_the_look_that_is_noted(
    original: DataSet, exported: Path
) -> None:
    for index, recording in enumerate(original.recordings()):
        video, errors = frames(ExportFolder(exported).video("head", index)), []
        for look in looks(exported):
            source = ImageSource(TASK, size=OPTIONS.size, cameras=("head",), look=look or "")
            image = source.images(recording, 0)["head"]
            errors.append(np.mean((video[0] - image.astype(float)) ** 2))
            source.close()
        assert np.argmin(errors) == index
        assert 10 * np.log10(255**2 / errors[index]) > MIN_PSNR_DB


@pytest.mark.long
def test_looks_depend_on_no_number_of_workers_and_on_no_interruption(
    original: DataSet, exported: Path, tmp_path: Path
) -> None:
    export_lerobot(original, tmp_path / "two", OPTIONS, workers=2)
    assert files(tmp_path / "two") == files(exported)
    export(original, tmp_path / "lost")
    for index in (0, 2):
        ExportFolder(tmp_path / "lost").video("head", index).unlink()
    export(original, tmp_path / "lost")
    assert files(tmp_path / "lost") == files(exported)


@pytest.mark.slow
def test_an_episode_keeps_its_look_among_others(
    original: DataSet, data: DataSet, real: DataSet, exported: Path, tmp_path: Path
) -> None:
    data.episodes()[0].unlink()
    assert export(data, tmp_path / "fewer") == looks(exported)[1:]
    merge([original], tmp_path / "copy")
    copy = DataSet.open(tmp_path / "copy")
    mixed = export([real, copy], tmp_path / "mixed", size=SIZE)
    assert mixed == [None, None, None, *looks(exported)]  # a video has the look that it has


def test_a_number_chooses_other_looks(original: DataSet, exported: Path, tmp_path: Path) -> None:
    assert not {*export(original, tmp_path / "other", look=f"{PER_EPISODE}:1")} & {*looks(exported)}
    assert export(original, tmp_path / "first", look=f"{PER_EPISODE}:0") == looks(exported)
    assert export(original, tmp_path / "blind", cameras=()) == [None] * EPISODES
    with pytest.raises(OtherRunError, match=f"look default instead of {PER_EPISODE}"):
        export(original, exported, look="default")


def test_layouts_of_other_seeds_have_other_looks(
    data: DataSet, exported: Path, tmp_path: Path
) -> None:
    """Two recordings with the same names of files, as every data set has."""
    first, second, _ = data.episodes()
    recording = Recording.read(second)  # in other words: what is there twice is exported once
    replace(recording, info=replace(recording.info, instruction="Sort.")).write(first)
    look, *others = export(data, tmp_path / "out")
    assert look not in looks(exported)
    assert others == looks(exported)[1:]


@pytest.mark.parametrize(
    ("look", "error", "message"),
    [
        ("random_per_episod", UnknownNameError, PER_EPISODE),
        (f"{PER_EPISODE}:x", DataError, f"{PER_EPISODE}:SEED.*got '{PER_EPISODE}:x'"),
        (f"{PER_EPISODE}:", DataError, f"{PER_EPISODE}:SEED.*got '{PER_EPISODE}:'"),
        ("random:x", DataError, "random:SEED.*got 'random:x'"),
        ("random", UnknownNameError, "random:SEED"),
        ("dark:3", UnknownNameError, "dark"),
    ],
)
def test_what_names_no_look_is_refused(look: str, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        ExportOptions(look=look)


def test_a_look_of_an_export_is_one_of_the_catalogue(exported: Path) -> None:
    for name in looks(exported):
        number = int((name or "").removeprefix("random:"))
        assert random_look(number).seed == number
