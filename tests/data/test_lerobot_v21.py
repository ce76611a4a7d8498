"""Exports in LeRobot's format v2.1, read as its readers do: LeRobot 0.3, Isaac-GR00T and openpi."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from duobench.core.errors import OtherRunError, UnknownNameError
from duobench.core.files import digest_of
from duobench.data import DataSet
from duobench.data.lerobot import v21
from duobench.data.lerobot.export import export_lerobot
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.lerobot.options import ExportOptions, Format
from duobench.envs.action_labels import LABELS
from duobench.envs.state_labels import StatePart
from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.data.conftest import EPISODES
from tests.data.test_lerobot import files
from tests.data.tools import HORIZON, TASK

OPTIONS = ExportOptions(size=(32, 48), format=Format.V21, state=(StatePart.TCP_POSE,))
VIDEO_PATH = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
COLUMNS = {"state": "observation.state", "action": "action"}
"""Where Isaac-GR00T looks for a modality whose numbers name no column."""


@pytest.fixture(scope="module")
def exported(original: DataSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("v21") / "out"
    export_lerobot(original, out, OPTIONS, workers=0)
    return out


def load(folder: Path, name: str) -> dict[str, Any]:
    return json.loads((folder / name).read_text())


def lines(folder: Path, name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "meta" / name).read_text().splitlines()]


def table(folder: Path, episode: int) -> dict[str, np.ndarray]:
    """The columns of an episode, whose file is found as the format says."""
    info = load(folder, "meta/info.json")
    chunk = episode // info["chunks_size"]
    path = folder / info["data_path"].format(episode_chunk=chunk, episode_index=episode)
    read = pq.read_table(path)
    return {name: np.array(read.column(name).to_pylist()) for name in read.column_names}


def whole(folder: Path) -> dict[str, np.ndarray]:
    tables = [table(folder, episode) for episode in range(len(lines(folder, "episodes.jsonl")))]
    return {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}


def test_what_is_where_is_said_as_lerobot_reads_it(original: DataSet, exported: Path) -> None:
    info = load(exported, "meta/info.json")
    expected = {
        "codebase_version": "v2.1",
        "robot_type": "franka_fr3_duo",
        "total_episodes": EPISODES,
        "total_frames": EPISODES * HORIZON,
        "total_tasks": 1,
        "total_videos": EPISODES * len(POLICY_CAMERAS),
        "total_chunks": 1,
        "chunks_size": 1000,
        "fps": 30,
        "splits": {"train": f"0:{EPISODES}"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": VIDEO_PATH,
    }
    assert {**info, "features": None} == {**expected, "features": None}
    (task,) = lines(exported, "tasks.jsonl")
    assert task["task_index"] == 0
    assert lines(exported, "episodes.jsonl") == [
        {
            "episode_index": index,
            "tasks": [task["task"]],
            "length": HORIZON,
            "recording": path.relative_to(original.path).as_posix(),
            "recording_sha256": digest_of(path),
        }
        for index, path in enumerate(original.episodes())
    ]
    for camera in POLICY_CAMERAS:
        key = f"observation.images.{camera}"
        assert info["features"][key]["dtype"] == "video"
        for index in range(EPISODES):
            where = {"episode_chunk": 0, "video_key": key, "episode_index": index}
            assert (exported / info["video_path"].format(**where)).exists()


def test_rows_and_images_are_those_of_the_newer_format(
    original: DataSet, exported: Path, tmp_path: Path
) -> None:
    options = replace(OPTIONS, format=Format.V30)
    export_lerobot(original, tmp_path / "v30", options, workers=0)
    older, newer = ExportFolder(exported, Format.V21), ExportFolder(tmp_path / "v30")
    for index in range(EPISODES):
        one, two = (pq.read_table(each.data(index)) for each in (older, newer))
        assert one.equals(two)
        for camera in POLICY_CAMERAS:
            one, two = (each.video(camera, index).read_bytes() for each in (older, newer))
            assert one == two
    features = [load(path, "meta/info.json")["features"] for path in (exported, tmp_path / "v30")]
    assert features[0] == features[1]
    about = json.loads(pq.read_schema(older.data(0)).metadata[b"huggingface"])["info"]["features"]
    assert about["observation.state"] == {  # older readers know no "List"
        "feature": {"dtype": "float32", "_type": "Value"},
        "length": 30,
        "_type": "Sequence",
    }


def test_statistics_of_episodes_add_up_to_those_of_all(exported: Path) -> None:
    episodes = [line["stats"] for line in lines(exported, "episodes_stats.jsonl")]
    rows = whole(exported)
    assert [{*stats} for stats in episodes] == [{*load(exported, "meta/info.json")["features"]}] * 3
    for name, column in rows.items():
        stats = {
            kind: np.array([each[name][kind] for each in episodes]) for kind in episodes[0][name]
        }
        values = column.reshape(len(column), -1).astype(float)
        assert stats["count"].tolist() == [[HORIZON]] * EPISODES
        np.testing.assert_allclose(stats["mean"].mean(axis=0), values.mean(axis=0), atol=1e-9)
        np.testing.assert_array_equal(stats["min"].min(axis=0), values.min(axis=0))
        np.testing.assert_array_equal(stats["max"].max(axis=0), values.max(axis=0))
        spread = stats["std"] ** 2 + (stats["mean"] - stats["mean"].mean(axis=0)) ** 2
        np.testing.assert_allclose(np.sqrt(spread.mean(axis=0)), values.std(axis=0), atol=1e-9)
    for stats in episodes:
        for kind, values in stats["observation.images.head"].items():
            assert np.shape(values) == ((1,) if kind == "count" else (3, 1, 1))


def test_groot_finds_named_parts_images_and_words(exported: Path) -> None:
    modality, info = load(exported, "meta/modality.json"), load(exported, "meta/info.json")
    assert {*modality} == {"state", "action", "video", "annotation"}
    stats, rows = load(exported, "meta/stats.json"), whole(exported)
    for kind, column in COLUMNS.items():
        names = info["features"][column]["names"]
        ends = [0, *(each["end"] for each in modality[kind].values())]
        assert [each["start"] for each in modality[kind].values()] == ends[:-1]
        assert ends[-1] == len(names)
        for part, each in modality[kind].items():
            inside = slice(each["start"], each["end"])
            side = part.partition("_")[0]
            assert {name.partition("_")[0] for name in names[inside]} == {side}
            for numbers in stats[column].values():  # it slices every one that it finds
                assert len(numbers[inside]) == inside.stop - inside.start
    assert modality["state"]["right_eef_quaternion"] == {"start": 26, "end": 30}
    for key, values in stats.items():
        assert {*values} == {"mean", "std", "min", "max", "q01", "q99"}
        np.testing.assert_allclose(
            values["q99"],
            np.quantile(rows[key].reshape(len(rows[key]), -1).astype(float), 0.99, axis=0),
        )
    floats = {key for key, each in info["features"].items() if each["dtype"] == "float32"}
    assert floats <= {*stats}
    for camera, each in modality["video"].items():
        about = info["features"][each["original_key"]]
        assert each == {"original_key": f"observation.images.{camera}"}
        assert about["shape"][about["names"].index("height")] == 32
        assert about["shape"][about["names"].index("channels")] == 3
        assert about["info"]["video.fps"] == 30
    (words,) = modality["annotation"].values()
    told = {each["task_index"]: each["task"] for each in lines(exported, "tasks.jsonl")}
    assert {told[number] for number in rows[words["original_key"]]} == {*told.values()}


@pytest.mark.parametrize("action", LABELS)
@pytest.mark.parametrize("state", [(), tuple(StatePart)])
def test_every_number_belongs_to_a_part(
    original: DataSet, tmp_path: Path, action: str, state: tuple[StatePart, ...]
) -> None:
    options = ExportOptions(cameras=(), format=Format.V21, action=action, state=state)
    export_lerobot(original, tmp_path / "out", options, workers=0)
    modality, info = (load(tmp_path / "out", f"meta/{name}.json") for name in ("modality", "info"))
    for kind, column in COLUMNS.items():
        parts = modality[kind].values()
        assert (
            sum(each["end"] - each["start"] for each in parts)
            == info["features"][column]["shape"][0]
        )
    assert (modality["video"], info["video_path"], info["total_videos"]) == ({}, None, 0)
    assert not (tmp_path / "out/videos").exists()


def test_openpi_finds_its_statistics(exported: Path) -> None:
    folder = exported / "assets" / "duobench"  # assets_dir / asset_id
    assert exported / v21.NORM_STATS == folder / "norm_stats.json"
    (stats,), rows = load(folder, "norm_stats.json").values(), whole(exported)
    assert load(folder, "norm_stats.json").keys() == {"norm_stats"}
    assert stats.keys() == {"state", "actions"}
    for key, column in (("state", "observation.state"), ("actions", "action")):
        values = rows[column].astype(float)
        expected = {
            "mean": values.mean(axis=0),
            "std": values.std(axis=0),
            "q01": np.quantile(values, 0.01, axis=0),
            "q99": np.quantile(values, 0.99, axis=0),
        }
        assert stats[key].keys() == expected.keys()
        for name, numbers in expected.items():
            np.testing.assert_allclose(stats[key][name], numbers, rtol=1e-9, err_msg=name)


@pytest.mark.long
def test_an_export_goes_on_in_its_format_alone(
    original: DataSet, exported: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    export_lerobot(original, out, OPTIONS, workers=2)
    assert files(out) == files(exported)
    ExportFolder(out, Format.V21).video("head", 1).unlink()
    ExportFolder(out, Format.V21).data(2).unlink()
    seen: list[int] = []
    export_lerobot(original, out, OPTIONS, workers=0, progress=lambda done, _: seen.append(done))
    assert seen == [HORIZON, 2 * HORIZON, 3 * HORIZON]
    assert files(out) == files(exported)
    with pytest.raises(OtherRunError, match=r"format v3\.0 instead of v2\.1"):
        export_lerobot(original, out, replace(OPTIONS, format=Format.V30), workers=0)
    assert files(out) == files(exported)


def test_a_thousand_episodes_are_a_chunk() -> None:
    folder = ExportFolder(Path("out"), Format.V21)
    assert folder.data(999) == Path("out/data/chunk-000/episode_000999.parquet")
    assert folder.data(1000) == Path("out/data/chunk-001/episode_001000.parquet")
    assert folder.video("head", 2345) == Path(
        "out/videos/chunk-002/observation.images.head/episode_002345.mp4"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [({"format": "v2.0"}, "v2.1"), ({"state": ("tcp_poses",)}, "tcp_pose")],
)
def test_what_is_not_known_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UnknownNameError, match=message):
        ExportOptions(**options)
    assert ExportOptions(format="v2.1").format is Format.V21  # pyright: ignore


def test_each_task_is_a_whole_of_its_own(original: DataSet, tmp_path: Path) -> None:
    options = replace(OPTIONS, cameras=(), object_state=True)
    export_lerobot(original, tmp_path / "out", options, per_task=True, workers=0)
    folder = tmp_path / "out" / TASK
    assert (folder / v21.NORM_STATS).exists()
    assert "observation.environment_state" in load(folder, "meta/stats.json")
    assert len(lines(folder, "episodes.jsonl")) == EPISODES
