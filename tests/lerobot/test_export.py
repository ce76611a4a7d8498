"""LeRobot itself reads, merges and trains on what `duobench export lerobot` writes."""

import json
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import duobench
from duobench.core.types import CONTROL_HZ
from duobench.data.dataset import DataSet
from duobench.data.images import ImageSource
from duobench.data.lerobot.export import export_lerobot
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.lerobot.options import ExportOptions, Format
from duobench.data.recorder import Recorder
from duobench.data.recording import Recording
from duobench.envs.action_labels import POSE_LABELS
from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.lerobot.tools import load, record, run

TASKS = ("transfer_cube", "bin_sort")
LENGTHS = (24, 31)
SIDE = duobench.Camera(
    name="side", position=(0.5, 1.2, 0.5), look_at=(0.5, 0.0, 0.0), size=(32, 48)
)
MIN_PSNR_DB = 30.0
CHUNK = 8


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    data = DataSet.open(tmp_path_factory.mktemp("data") / "demos")
    for task, length in zip(TASKS, LENGTHS, strict=True):
        env = Recorder(duobench.make(task, cameras=(), horizon=length), data)
        record(env, seed=length)
    return data


@pytest.fixture(scope="module")
def recordings(data: DataSet) -> list[Recording]:
    return list(data.recordings())


@pytest.fixture(scope="module")
def exported(data: DataSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("export") / "lerobot"
    export_lerobot(data, out, ExportOptions(), workers=0)
    return out


def test_columns_are_those_that_were_written(
    data: DataSet, exported: Path, recordings: list[Recording]
) -> None:
    """What is written is what was recorded: tests/data/test_lerobot.py."""
    from lerobot.utils.feature_utils import dataset_to_policy_features

    dataset, folder, row = load(exported), ExportFolder(exported), 0
    assert (dataset.num_episodes, dataset.num_frames) == (len(LENGTHS), sum(LENGTHS))
    assert dataset.fps == CONTROL_HZ
    for index, recording in enumerate(recordings):
        for written in pq.read_table(folder.data(index)).to_pylist():
            item = dataset[row]
            for name, value in written.items():
                np.testing.assert_array_equal(item[name].numpy(), value, err_msg=name)
            assert item["task"] == recording.info.instruction
            row += 1
    names = [path.relative_to(data.path).as_posix() for path in data.episodes()]
    assert list(dataset.meta.episodes["recording"]) == names
    assert set(dataset_to_policy_features(dataset.meta.features)) == {
        "observation.state",
        "action",
        *(f"observation.images.{camera}" for camera in POLICY_CAMERAS),
    }


def test_frames_are_those_of_a_fresh_rendering(exported: Path, recordings: list[Recording]) -> None:
    dataset, first, worst = load(exported), 0, np.inf
    shades = []
    for recording in recordings:
        images = ImageSource(recording.info.task)
        for step in range(len(recording)):
            item = dataset[first + step]
            for camera, image in images.images(recording, step).items():
                frame = item[f"observation.images.{camera}"].numpy().transpose(1, 2, 0)
                error = np.mean((frame - image / 255) ** 2)
                shades.append(255 * frame.mean(axis=(0, 1)) - image.mean(axis=(0, 1)))
                worst = min(worst, -10 * np.log10(error))
        images.close()
        first += len(recording)
    assert worst > MIN_PSNR_DB
    assert np.abs(np.mean(shades, axis=0)).max() < 0.9, "red, green, blue, of 255"


def test_objects_and_tool_poses_are_columns_without_images(data: DataSet, tmp_path: Path) -> None:
    task = TASKS[1]
    options = ExportOptions(tasks=(task,), cameras=(), object_state=True, action="cartesian")
    export_lerobot(data, tmp_path / "out", options, workers=0)
    dataset, source = load(tmp_path / "out"), ImageSource(task, cameras=())
    (recording,) = data.recordings(task)
    for step in range(len(recording)):
        objects = dataset[step]["observation.environment_state"]
        np.testing.assert_array_equal(objects, source.objects(recording, step))
    assert dataset.meta.features["action"]["names"] == [*POSE_LABELS]
    assert dataset[0]["action"].shape == (len(POSE_LABELS),)


def test_an_action_window_stops_at_the_end_of_its_episode(
    exported: Path, recordings: list[Recording]
) -> None:
    window = [step / CONTROL_HZ for step in range(CHUNK)]
    item = load(exported, delta_timestamps={"action": window})[len(recordings[0]) - 3]
    assert item["action_is_pad"].tolist() == [False] * 3 + [True] * (CHUNK - 3)
    np.testing.assert_array_equal(item["action"][:3], recordings[0].action[-3:].astype("f4"))


def test_statistics_are_those_that_were_written(exported: Path) -> None:
    written, read = (
        json.loads((exported / "meta/stats.json").read_text()),
        load(exported).meta.stats,
    )
    assert read.keys() == written.keys()
    for feature, numbers in written.items():
        for name, values in numbers.items():
            np.testing.assert_array_equal(read[feature][name], values)
    assert read["observation.images.head"]["max"].shape == (3, 1, 1)
    assert read["observation.images.head"]["count"] == [sum(LENGTHS)]


@pytest.fixture(scope="module")
def measured(data: DataSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("depth") / "lerobot"
    options = ExportOptions(cameras=("left_wrist", SIDE), depth=True, size=(48, 64))
    export_lerobot(data, out, options, workers=0)
    return out


def test_depth_is_read_as_metres_where_it_was_rendered(
    measured: Path, recordings: list[Recording]
) -> None:
    """Rounding to 12 bits is all that is lost; nothing stays nothing."""
    dataset, first = load(measured, depth_output_unit="m"), 0
    keys = {f"observation.images.{name}_depth": name for name in ("left_wrist", "side")}
    assert {*dataset.meta.depth_keys} == keys.keys()
    for recording in recordings:
        source = ImageSource(
            recording.info.task, cameras=("left_wrist", SIDE), size=(48, 64), depth=True
        )
        for step in range(len(recording)):
            item = dataset[first + step]
            seen = source.images_by_kind(recording, step)["depth"]
            placed = source.geometry(recording, step)
            for key, name in keys.items():
                read = item[key].numpy()[0]
                assert read.shape == seen[name].shape
                assert (np.abs(read - seen[name]) <= 0.0003 * (1.0 + seen[name])).all()
                assert ((read == 0.0) == (seen[name] == 0.0)).all()
            row = item["table_from_camera.left_wrist"].numpy().reshape(4, 4)
            np.testing.assert_allclose(row, placed["left_wrist"].table_from_camera, atol=1e-6)
        source.close()
        first += len(recording)
    info = dataset.meta.features["observation.images.side_depth"]["info"]
    np.testing.assert_allclose(info["matrix"], placed["side"].matrix)
    np.testing.assert_allclose(info["table_from_camera"], placed["side"].table_from_camera)


def test_depth_and_its_statistics_are_given_in_millimetres_too(measured: Path) -> None:
    key = "observation.images.side_depth"
    metres, millimetres = load(measured, depth_output_unit="m"), load(measured)
    np.testing.assert_allclose(millimetres[3][key], 1000 * metres[3][key], atol=0.51)
    for name in ("min", "max", "mean", "q50"):
        one, two = metres.meta.stats[key][name], millimetres.meta.stats[key][name]
        assert one.shape == (1, 1, 1)
        np.testing.assert_allclose(two, 1000 * one, rtol=1e-6)
    every = np.stack([metres[row][key].numpy() for row in range(sum(LENGTHS))])
    np.testing.assert_allclose(metres.meta.stats[key]["mean"], every.mean(), rtol=1e-5)


def test_lerobot_merges_it_with_a_set_of_its_own_writer(exported: Path, tmp_path: Path) -> None:
    from lerobot.datasets import LeRobotDataset

    info = json.loads((exported / "meta" / "info.json").read_text())
    own = ("timestamp", "frame_index", "episode_index", "index", "task_index")
    features = {
        name: {**feature, "shape": tuple(feature["shape"])}
        for name, feature in info["features"].items()
        if name not in own
    }
    for feature in features.values():
        feature.pop("info", None)
    other = LeRobotDataset.create(
        "duobench/other", fps=30, features=features, root=tmp_path / "other",
        robot_type=info["robot_type"],
    )  # fmt: skip
    for step in range(5):
        frame = {
            name: np.full(feature["shape"], step % 2, feature["dtype"].replace("video", "uint8"))
            for name, feature in features.items()
        }
        other.add_frame({**frame, "task": "Wait."})
    other.save_episode()
    other.finalize()
    words = [
        "--new_repo_id=duobench/merged",
        f"--new_root={tmp_path / 'merged'}",
        "--operation.type=merge",
        "--operation.repo_ids=['duobench/demos', 'duobench/other']",
        f"--operation.roots=['{exported}', '{tmp_path / 'other'}']",
    ]
    run(["lerobot-edit-dataset", *words])
    merged, single = load(tmp_path / "merged"), load(exported)
    assert merged.num_episodes == len(LENGTHS) + 1
    assert merged.num_frames == sum(LENGTHS) + 5
    names = list(merged.meta.episodes["recording"])
    assert names[: len(LENGTHS)] == list(single.meta.episodes["recording"])
    for row in (0, LENGTHS[0], sum(LENGTHS) - 1):
        one, two = single[row], merged[row]
        for key in ("action", *(f"observation.images.{camera}" for camera in POLICY_CAMERAS)):
            np.testing.assert_array_equal(one[key], two[key])


def test_the_older_format_becomes_the_newer_one_by_lerobots_own_converter(
    data: DataSet, exported: Path, tmp_path: Path
) -> None:
    """It reads every file of v2.1, and what it makes of them is the newer export."""
    options = ExportOptions(format=Format.V21)
    export_lerobot(data, tmp_path / "set", options, workers=0)
    module = "lerobot.scripts.convert_dataset_v21_to_v30"
    words = ["--repo-id=local/set", f"--root={tmp_path / 'set'}", "--push-to-hub=false"]
    run([sys.executable, "-m", module, *words])
    converted, newer = load(tmp_path / "set"), load(exported)
    assert (converted.num_episodes, converted.num_frames) == (len(LENGTHS), sum(LENGTHS))
    for row in (0, LENGTHS[0] - 1, LENGTHS[0], sum(LENGTHS) - 1):
        one, two = converted[row], newer[row]
        assert one.keys() == two.keys()
        for key, value in two.items():
            np.testing.assert_array_equal(one[key], value, err_msg=key)
    for kind in ("mean", "std", "min", "max"):
        one, two = (each.meta.stats["action"][kind] for each in (converted, newer))
        np.testing.assert_allclose(one, two, atol=1e-6)
