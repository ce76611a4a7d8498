"""Data sets with videos: checked, merged, split, looked at and exported."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from duobench.cli import main
from duobench.data import DataSet, ExportOptions, Recording, export_lerobot, find_problems
from duobench.data.arrange import merge, split
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.schema import Domain, video_path
from duobench.data.views import plain_view, resized
from duobench.errors import DataError, NamesTakenError
from duobench.rig_sessions.cameras import view_of
from duobench.types import POLICY_CAMERAS
from tests.data.real.number_duo import (
    SIZE,
    TASK,
    NumberDuo,
    image_of,
    numbers_in,
    play_real,
    real_recorder,
)
from tests.data.tools import play, recorder

LENGTHS = (12, 9, 15)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    folder = tmp_path_factory.mktemp("data") / "real"
    for length in LENGTHS:
        env, _ = real_recorder(folder, horizon=length)
        play_real(env, length)
        env.close()
    return DataSet.open(folder)


@pytest.fixture
def data(original: DataSet, tmp_path: Path) -> DataSet:
    """A copy of its own, to spoil."""
    shutil.copytree(original.path, tmp_path / "real")
    return DataSet.open(tmp_path / "real")


def contents(data: DataSet) -> list[bytes]:
    return sorted(path.read_bytes() for path in (*data.episodes(), *data.videos()))


def test_a_sound_data_set_has_no_problems(original: DataSet) -> None:
    assert find_problems(original) == []
    assert len(original.videos()) == len(LENGTHS) * len(POLICY_CAMERAS)


def shorten(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [(Path.unlink, "is missing"), (shorten, "frames, not"), (flip, "00001.head.mp4 has")],
)
def test_what_is_wrong_with_a_video_is_found(
    data: DataSet, spoil: Callable[[Path], None], complaint: str
) -> None:
    path = data.episode(TASK, "00001")
    spoil(video_path(path, "head"))
    (problem,) = find_problems(data)
    assert problem.path == path
    assert complaint in problem.what


def test_videos_and_episodes_that_lost_each_other_are_found(
    data: DataSet, capsys: pytest.CaptureFixture[str]
) -> None:
    path = data.episode(TASK, "00000")
    path.unlink()
    video_path(path, "head").rename(path.with_name("notes.mp4"))
    with pytest.raises(SystemExit):
        main(["data", "check", str(data.path)])
    said = capsys.readouterr().out
    assert said.count("It is a video without an episode.") == 3
    assert "notes.mp4" in said


def test_rows_that_name_other_frames_are_found(data: DataSet) -> None:
    path = data.episode(TASK, "00002")
    recording = Recording.read(path)
    frame = recording.frame.copy()
    frame[-1, 0] = 99
    frame[5, 1] = 0
    replace(recording, frame=frame).write(path)
    said = " ".join(problem.what for problem in find_problems(data))
    assert "name frame 99 of 00002.head.mp4" in said
    assert "go back in 00002.left_wrist.mp4" in said


def test_what_is_split_is_merged_again_with_its_videos(original: DataSet, tmp_path: Path) -> None:
    one, two, whole = (tmp_path / name for name in ("one", "two", "whole"))
    assert split(original, one, two, fraction=0.67) == (2, 1)
    assert len(DataSet(one).videos()) == 6
    assert find_problems(DataSet.open(one)) == find_problems(DataSet.open(two)) == []
    for _ in range(2):  # the second time nothing is left to do
        assert merge([DataSet.open(one), DataSet.open(two)], whole) == 3
        assert contents(DataSet(whole)) == contents(original)
    names = [path.relative_to(whole) for path in DataSet(whole).episodes()]
    assert names == [path.relative_to(original.path) for path in original.episodes()]


def test_a_merge_that_was_interrupted_goes_on(original: DataSet, tmp_path: Path) -> None:
    merge([original], tmp_path / "out")
    out = DataSet(tmp_path / "out")
    out.episode(TASK, "00001").unlink()  # its videos were copied first
    merge([original], out.path)
    assert contents(out) == contents(original)


def test_equal_names_are_renamed_with_their_videos(
    original: DataSet, data: DataSet, tmp_path: Path
) -> None:
    for path in data.episodes():  # other episodes of the same names
        recording = Recording.read(path)
        replace(recording, info=replace(recording.info, instruction="Again.")).write(path)
    out = DataSet(tmp_path / "out")
    with pytest.raises(NamesTakenError):
        merge([original, data], out.path)
    assert out.videos() == []
    for _ in range(2):
        assert merge([original, data], out.path, rename=True) == 2 * len(LENGTHS)
        assert [path.stem for path in out.episodes()] == [f"{n:05d}" for n in range(6)]
        assert contents(out) == sorted(
            [*contents(original), *(p.read_bytes() for p in [*data.episodes(), *data.videos()])]
        )
    assert find_problems(DataSet.open(out.path)) == []
    for number, length in enumerate(2 * LENGTHS):
        path = out.episode(TASK, f"{number:05d}")
        assert len(Recording.read(path)) == length
        assert len(numbers_in(video_path(path, "head"))) == length + 1


def test_nothing_is_merged_over_a_recording_that_runs(original: DataSet, tmp_path: Path) -> None:
    env, _ = real_recorder(tmp_path)
    play_real(env, 5)
    with pytest.raises(NamesTakenError):
        merge([original], tmp_path)
    merge([original], tmp_path, rename=True)
    env.close()
    assert find_problems(DataSet.open(tmp_path)) == []
    assert len(DataSet(tmp_path).episodes()) == len(LENGTHS) + 1


def test_an_episode_without_its_video_is_not_copied(data: DataSet, tmp_path: Path) -> None:
    video_path(data.episodes()[1], "head").unlink()
    with pytest.raises(DataError, match=r"head\.mp4 is missing"):
        merge([data], tmp_path / "out")
    with pytest.raises(DataError, match=r"head\.mp4 is missing"):
        split(data, tmp_path / "a", tmp_path / "b", fraction=0.5)


def test_info_and_page_say_where_episodes_are_from(
    data: DataSet, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["data", "info", str(data.path)])
    assert "3 real (simulated, simulated drivers)" in capsys.readouterr().out
    text = (data.path / "index.html").read_text()
    assert "3 real (simulated, simulated drivers)" in text
    assert text.count("data:image/jpeg") == 1


# --- mixed data ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    folder = tmp_path_factory.mktemp("data") / "sim"
    env = recorder(folder, split="train", horizon=10)
    play(env, 10)
    env.close()
    return DataSet.open(folder)


def test_both_domains_are_exported_together(
    original: DataSet, simulated: DataSet, tmp_path: Path
) -> None:
    options = ExportOptions(size=SIZE)
    done = export_lerobot([simulated, original], tmp_path / "mixed", options, workers=0)
    assert (done.episodes, done.frames) == (4, 10 + sum(LENGTHS))
    folder = ExportFolder(tmp_path / "mixed")
    tables = [pq.read_table(folder.data(index)) for index in range(4)]
    assert [set(table["domain"].to_pylist()) for table in tables] == [{0}, {1}, {1}, {1}]
    assert tables[3]["index"][0].as_py() == 10 + sum(LENGTHS[:2])
    for index, path in enumerate(original.episodes(), start=1):
        recording = Recording.read(path)
        for place, camera in enumerate(POLICY_CAMERAS):
            assert (
                numbers_in(folder.video(camera, index))
                == recording.frame_number[:-1, place].tolist()
            )
    export_lerobot([simulated, original], tmp_path / "again", options, workers=2)
    for path in folder.path.rglob("*.mp4"):
        other = tmp_path / "again" / path.relative_to(folder.path)
        assert other.read_bytes() == path.read_bytes()


def test_one_domain_of_a_mixed_data_set_is_exported_alone(
    original: DataSet, simulated: DataSet, tmp_path: Path
) -> None:
    merge([simulated, original], tmp_path / "all", rename=True)
    data = DataSet.open(tmp_path / "all")
    assert len(data.episodes()) == 4
    for domain, episodes in ((Domain.SIM, 1), (Domain.REAL, 3)):
        options = ExportOptions(size=SIZE, cameras=("head",), domains=(domain,))
        done = export_lerobot(data, tmp_path / domain, options, workers=0)
        assert (done.episodes, done.left_out) == (episodes, 4 - episodes)


def test_a_camera_that_a_rig_lacks_is_named(tmp_path: Path) -> None:
    env, _ = real_recorder(tmp_path / "data", NumberDuo(cameras=("head",)), horizon=5)
    play_real(env, 5)
    env.close()
    with pytest.raises(DataError, match="no video of the camera left_wrist; it has head"):
        export_lerobot(DataSet.open(tmp_path / "data"), tmp_path / "out", workers=0)


def test_views_resize_by_mean_and_straighten_what_was_measured() -> None:
    image = image_of(5)
    assert (resized(image, (4, 8))[0, :, 0] == image[0, ::6, 0]).all()
    about = {"driver": "simulated", "size": list(SIZE), "calibration": None}
    np.testing.assert_array_equal(view_of("head", about)(image, (4, 8)), resized(image, (4, 8)))
    lens = {"fx": 700.0, "fy": 700.0, "cx": 640.0, "cy": 360.0, "pose": [0, 0, 0, 0, 0, 0, 1]}
    about |= {"calibration": lens, "size": [720, 1280]}
    native = image_of(5, (720, 1280))
    shown = view_of("head", about)(native, (72, 128))
    assert (shown != resized(native, (72, 128))).any()
    with pytest.raises(DataError, match="lens of its own"):
        plain_view("head", about)
    with pytest.raises(DataError, match="camera head is invalid"):
        view_of("head", {"driver": "kinect"})
