import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq
import pytest

from duobench.core.errors import (
    DataError,
    OptionError,
    OtherRunError,
    OutputError,
    RenderingError,
    UnknownNameError,
)
from duobench.core.files import locked
from duobench.data import DataSet, ImageSource, Recording
from duobench.data.arrange import merge
from duobench.data.images import plain_view, resized
from duobench.data.lerobot import metadata
from duobench.data.lerobot.export import Exported, export_lerobot, write_videos
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.lerobot.options import ActionSource, ExportOptions, Format, Pairing
from duobench.data.schema import Domain
from duobench.envs.state_labels import StatePart
from duobench.policy.training.training import plan_all
from duobench.real.canonical import view_of
from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.data.conftest import EPISODES, LENGTHS
from tests.data.real.number_duo import (
    SIZE,
    NumberDuo,
    image_of,
    numbers_in,
    play_real,
    real_recorder,
)
from tests.data.tools import HORIZON, SOURCES, TASK, child_of, ended, recorder, room
from tests.evaluation.processes import children, is_running, wait_until

SMALL = ExportOptions(size=(32, 48))
MIN_PSNR_DB = 25.0  # for tiny images, whose every edge is a frequency that the codec drops
COMMAND = ["export", "lerobot", "--size", "32", "48"]


@pytest.fixture(scope="module")
def exported(original: DataSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("export") / "whole"
    assert export_lerobot(original, out, SMALL, workers=0).frames == EPISODES * HORIZON
    return out


def files(folder: Path) -> dict[str, bytes]:
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def frames(path: Path) -> list[np.ndarray]:
    with av.open(path) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def columns(folder: Path, index: int = 0) -> dict[str, np.ndarray]:
    table = pq.read_table(ExportFolder(folder).data(index))
    return {name: np.array(table.column(name).to_pylist()) for name in table.column_names}


def export(data: DataSet, out: Path, **options: Any) -> Exported:
    """An export without images, unless cameras are among the options, in this process."""
    return export_lerobot(data, out, replace(SMALL, **{"cameras": (), **options}), workers=0)


def test_a_camera_that_is_named_twice_is_one() -> None:
    assert ExportOptions(cameras=("head", "left_wrist", "head")).cameras == ("head", "left_wrist")


@pytest.mark.parametrize("cameras", [{"head", "left_wrist"}, {"head": (128, 128)}])
def test_cameras_without_an_order_are_refused(cameras: Any) -> None:
    with pytest.raises(DataError, match="One camera is taken, or a list of them"):
        ExportOptions(cameras=cameras)
    with pytest.raises(OptionError, match="a name, or a list of names"):
        ImageSource(TASK, cameras=cameras)


def test_words_are_as_good_as_what_they_stand_for() -> None:
    words = ExportOptions(
        tasks=TASK,  # type: ignore[arg-type]
        cameras="head",  # type: ignore[arg-type]
        size=64,  # type: ignore[arg-type]
        format="v2.1",  # type: ignore[arg-type]
        pairing="delayed",  # type: ignore[arg-type]
        action_source="sent",  # type: ignore[arg-type]
        state="tcp_pose",  # type: ignore[arg-type]
        domains="sim",  # type: ignore[arg-type]
    )
    assert words == ExportOptions(
        tasks=(TASK,),
        cameras=("head",),
        size=(64, 64),
        format=Format.V21,
        pairing=Pairing.DELAYED,
        action_source=ActionSource.SENT,
        state=(StatePart.TCP_POSE,),
        domains=(Domain.SIM,),
    )
    assert words.action_source is ActionSource.SENT


@pytest.mark.parametrize("pairing", Pairing)
def test_rows_pair_an_action_with_what_was_seen_before_or_after_it(
    original: DataSet, tmp_path: Path, pairing: Pairing
) -> None:
    export(original, tmp_path / "out", pairing=pairing)
    seen = slice(1, None) if pairing is Pairing.DELAYED else slice(-1)
    for index, recording in enumerate(original.recordings()):
        expected = {
            "observation.state": recording.agent_pos[seen],
            "action": recording.action.astype(np.float32),
            "next.reward": recording.reward.astype(np.float32),
            "next.success": recording.success[1:],
            "next.done": np.arange(HORIZON) == HORIZON - 1,
            "stage": recording.stage[seen],
            "index": HORIZON * index + np.arange(HORIZON),
            "domain": np.zeros(HORIZON),
            "recording_row": np.arange(HORIZON),
            "timestamp": (np.arange(HORIZON) / 30).astype(np.float32),
            "frame_index": np.arange(HORIZON),
            "episode_index": np.full(HORIZON, index),
            "task_index": np.zeros(HORIZON),
        }
        rows = columns(tmp_path / "out", index)
        assert rows.keys() == expected.keys()
        for name, values in expected.items():
            np.testing.assert_array_equal(rows[name], values, err_msg=name)


def test_videos_hold_every_frame_as_it_is_rendered(original: DataSet, exported: Path) -> None:
    recording, source = next(original.recordings()), ImageSource(TASK, size=SMALL.size)
    videos = {camera: frames(ExportFolder(exported).video(camera, 0)) for camera in SMALL.cameras}
    assert {len(video) for video in videos.values()} == {HORIZON}
    for row in range(HORIZON):
        for camera, image in source.images(recording, row).items():
            error = np.mean((videos[camera][row] - image.astype(float)) ** 2)
            assert 10 * np.log10(255**2 / error) > MIN_PSNR_DB
    source.close()


def test_a_look_changes_the_images_alone(original: DataSet, exported: Path, tmp_path: Path) -> None:
    export(original, tmp_path / "out", look="dark", cameras=("head",))
    dark, usual = (ExportFolder(path).video("head", 0) for path in (tmp_path / "out", exported))
    assert np.mean(frames(dark)) < 0.8 * np.mean(frames(usual))
    one, two = columns(tmp_path / "out"), columns(exported)
    assert all(np.array_equal(one[name], two[name]) for name in two)


def test_statistics_are_numpys(original: DataSet, exported: Path) -> None:
    stats = json.loads((exported / "meta" / "stats.json").read_text())
    source = ImageSource(TASK, size=SMALL.size, cameras=("head",))
    images = [
        source.images(recording, row)["head"]
        for recording in original.recordings()
        for row in range(HORIZON)
    ]
    source.close()
    actions = np.concatenate([each.action for each in original.recordings()]).astype(np.float32)
    values = {
        "action": actions.astype(np.float64),
        "observation.images.head": np.array(images).reshape(-1, 3) / 255,
    }
    for feature, rows in values.items():
        expected = {
            "min": rows.min(axis=0),
            "max": rows.max(axis=0),
            "mean": rows.mean(axis=0),
            "std": rows.std(axis=0),
            "count": EPISODES * HORIZON,
            **{name: np.quantile(rows, q, axis=0) for name, q in metadata.QUANTILES.items()},
        }
        assert stats[feature].keys() == expected.keys()
        for name, numbers in expected.items():
            found = np.ravel(stats[feature][name])
            np.testing.assert_allclose(found, numbers, rtol=1e-9, err_msg=name)


def test_quantiles_of_counts_interpolate_as_numpy_does() -> None:
    rng = np.random.default_rng(0)
    for size in (1, 2, 3, 7):
        image = rng.integers(0, 256, (size, 1, 3), dtype=np.uint8)
        counts = metadata.no_counts()
        metadata.count_values(counts, image)
        found = metadata.of_counts(counts, 1)
        for name, share in metadata.QUANTILES.items():
            expected = np.quantile(image.reshape(-1, 3) / 255, share, axis=0)
            np.testing.assert_allclose(found[name].ravel(), expected, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGINT])
def test_a_stopped_export_goes_on_to_the_same_files(
    original: DataSet, exported: Path, tmp_path: Path, stop: signal.Signals
) -> None:
    out = tmp_path / "stopped"
    command = ("duobench", *COMMAND, original.path, "--out", out, "--workers", 2)
    with child_of(*command) as process:
        wait_until(lambda: list(out.glob("meta/duobench/*.json")), "a finished episode")
        workers = children(process.pid)
        process.send_signal(stop)
        told, _ = process.communicate()
    assert ("goes on from there" in told) == (process.returncode == 130) == (stop == signal.SIGINT)
    assert workers
    wait_until(lambda: not any(map(is_running, workers)), "the end of the workers")
    assert not (out / "meta" / "info.json").exists()
    kept = {path: path.stat().st_mtime_ns for path in out.glob("meta/duobench/*.json")}
    with child_of(*command) as process:
        _, complaint = process.communicate()
    assert process.returncode == 0, complaint
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert files(out) == files(exported)


@pytest.mark.long
@pytest.mark.parametrize("words", [["data", "check"], [*COMMAND, "--out", "out"]])
def test_files_named_as_the_standard_library_do_no_harm(
    original: DataSet, tmp_path: Path, words: list[str]
) -> None:
    """They lie in the current folder, which comes first on the path of a process of Python."""
    for name in ("signal", "random", "queue", "tempfile", "socket"):
        (tmp_path / f"{name}.py").write_text("raise ImportError('not the real one')\n")
    (tmp_path / "bin").mkdir()
    command = tmp_path / "bin" / "duobench"  # as pip writes it; -P would be passed on
    command.write_text("from duobench.cli import main\nif __name__ == '__main__':\n    main()\n")
    done = subprocess.run(
        [sys.executable, str(command), *words, str(original.path), "--workers", "1"],
        env={**os.environ, "PYTHONPATH": SOURCES},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 episodes" in done.stdout


@pytest.mark.slow
def test_a_lost_file_is_made_again(original: DataSet, exported: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    export_lerobot(original, out, SMALL, workers=0)
    ExportFolder(out).video("head", 1).unlink()
    seen: list[int] = []
    export_lerobot(original, out, SMALL, workers=0, progress=lambda done, _total: seen.append(done))
    assert seen == [2 * HORIZON, 3 * HORIZON]
    assert files(out) == files(exported)


def halved(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.slow
@pytest.mark.parametrize("damage", [halved, emptied, Path.unlink])
@pytest.mark.parametrize("kind", ["data", "video"])
def test_a_damaged_file_is_not_trained_on_and_made_again(
    original: DataSet, exported: Path, tmp_path: Path, damage: Callable[[Path], None], kind: str
) -> None:
    out = shutil.copytree(exported, tmp_path / "out")
    folder = ExportFolder(out)
    plan_all("act", out, tmp_path / "training", tasks=[TASK])
    path = folder.data(1) if kind == "data" else folder.video("head", 1)
    damage(path)
    with pytest.raises(DataError, match=rf"{path} is not as the export left it; such files: 1\."):
        plan_all("act", out, tmp_path / "training", tasks=[TASK])
    seen: list[int] = []
    export_lerobot(original, out, SMALL, workers=0, progress=lambda done, _total: seen.append(done))
    assert seen == [2 * HORIZON, 3 * HORIZON]
    assert files(out) == files(exported)


@pytest.mark.parametrize(
    "name", ["tasks.parquet", "duobench/000001.json", "episodes/chunk-000/file-000.parquet"]
)
def test_an_export_without_a_file_that_describes_it_is_not_trained_on(
    exported: Path, tmp_path: Path, name: str
) -> None:
    out = shutil.copytree(exported, tmp_path / "out")
    (out / "meta" / name).unlink()
    with pytest.raises(DataError, match=f"meta/{name} is not as the export left it"):
        plan_all("act", out, tmp_path / "training", tasks=[TASK])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (64, 64)}, r"size \(64, 64\) instead of \(32, 48\)"),
        ({"look": "dark"}, "look dark instead of default"),
        ({"pairing": Pairing.DELAYED}, "pairing delayed instead of causal"),
        ({"cameras": ("head",)}, "cameras"),
    ],
)
def test_other_options_are_refused_with_the_difference(
    original: DataSet, exported: Path, options: dict[str, Any], message: str
) -> None:
    before = files(exported)
    with pytest.raises(OtherRunError, match=message):
        export_lerobot(original, exported, replace(SMALL, **options), workers=0)
    assert files(exported) == before


def test_another_data_set_is_refused(data: DataSet, tmp_path: Path) -> None:
    export(data, tmp_path / "out")
    data.episodes()[0].unlink()
    with pytest.raises(OtherRunError, match="episodes 1 removed"):
        export(data, tmp_path / "out")


def test_a_damaged_recording_stops_before_anything_is_written(
    data: DataSet, tmp_path: Path
) -> None:
    bad = data.episodes()[1]
    bad.write_bytes(bad.read_bytes()[:-100])
    with pytest.raises(DataError, match=bad.name):
        export(data, tmp_path / "out", cameras=SMALL.cameras)
    assert not (tmp_path / "out").exists()


def test_a_recording_that_changes_meanwhile_stops_the_export(data: DataSet, tmp_path: Path) -> None:
    first, second, _ = data.episodes()

    def change(done: int, _total: int) -> None:
        if done == HORIZON:
            second.write_bytes(first.read_bytes())

    options = replace(SMALL, cameras=())
    with pytest.raises(DataError, match=f"{second.name} has changed"):
        export_lerobot(data, tmp_path / "out", options, workers=0, progress=change)


def test_only_kept_episodes_are_exported(data: DataSet, tmp_path: Path) -> None:
    path = data.episodes()[0]
    recording = Recording.read(path)
    outcome = replace(ended(recording), kept=False, reason="A test.")
    replace(recording, info=replace(recording.info, outcome=outcome)).write(path)
    done = export(data, tmp_path / "out")
    assert (done.episodes, done.left_out) == (EPISODES - 1, 1)
    with pytest.raises(DataError, match="no episode to export"):
        export(data, tmp_path / "no", only_successes=True)


@pytest.mark.parametrize("per_task", [False, True])
def test_data_without_episodes_are_not_exported(
    data: DataSet, tmp_path: Path, per_task: bool
) -> None:
    for path in data.episodes():
        path.unlink()
    with pytest.raises(DataError, match="no episode to export, of 0 that were read"):
        export_lerobot(data, tmp_path / "no", SMALL, per_task=per_task)
    assert not (tmp_path / "no").exists()


def test_tasks_are_not_exported_into_a_data_set(original: DataSet, exported: Path) -> None:
    """Else a training would find the tasks' data sets, and not the one around them."""
    before = files(exported)
    with pytest.raises(OtherRunError, match=r"one data set of its own; .* into another folder"):
        export_lerobot(original, exported, SMALL, per_task=True, workers=0)
    assert files(exported) == before


@pytest.mark.parametrize("name", ["data/chunk-000/file-007.parquet", "videos/x/file.mp4"])
def test_files_of_no_episode_keep_an_export_from_going_on(
    original: DataSet, tmp_path: Path, name: str
) -> None:
    export(original, tmp_path / "out")
    path = tmp_path / "out" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(ExportFolder(tmp_path / "out").data(0), path)
    with pytest.raises(OtherRunError, match=r"is of no episode of this export.*too many: 1\."):
        export(original, tmp_path / "out")
    path.unlink()
    ExportFolder(tmp_path / "out").data(0).unlink()
    export(original, tmp_path / "out")
    assert ExportFolder(tmp_path / "out").data(0).exists()


def test_a_folder_of_something_else_is_left_alone(original: DataSet, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("precious")
    with pytest.raises(OtherRunError, match="not empty"):
        export(original, tmp_path)
    with pytest.raises(OutputError, match="which is read"):
        export(original, original.path / "out")
    with locked(tmp_path / "out"), pytest.raises(OutputError, match="Another process"):
        export(original, tmp_path / "out")


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"size": (33, 48)}, DataError, "even"),
        ({"size": (8, 2)}, DataError, "even numbers from 4 on"),
        ({"size": "large"}, DataError, "one number"),
        ({"pairing": "later"}, UnknownNameError, "delayed"),
        ({"action_source": "wanted"}, UnknownNameError, "intended"),
        ({"domains": ("dream",)}, UnknownNameError, "real"),
        ({"size": (722, 48)}, RenderingError, "1280x720"),
        ({"cameras": ("left_wrists",)}, UnknownNameError, "left_wrist"),
        ({"look": "wood_tabel"}, UnknownNameError, "wood_table"),
        ({"action": "cartesian_relatif"}, UnknownNameError, "cartesian_relative"),
        ({"tasks": ("sort_bin",)}, UnknownNameError, TASK),
    ],
)
def test_what_cannot_be_is_refused(
    original: DataSet, tmp_path: Path, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        export(original, tmp_path / "out", **options)
    with pytest.raises(DataError, match="workers"):
        export_lerobot(original, tmp_path / "out", replace(SMALL, cameras=()), workers=-1)


def test_tool_poses_become_joint_targets_near_the_observed_joints(tmp_path: Path) -> None:
    env = recorder(tmp_path / "data", action_mode="cartesian")
    observation, _ = env.reset(seed=0)
    pose = observation["tcp_pose"].reshape(2, 7)
    action = np.hstack([pose, np.full((2, 1), 0.5)])
    for step in range(HORIZON):
        action[:, 2] = pose[:, 2] + 0.002 * step
        env.step(action.ravel())
    env.close()
    data = DataSet.open(tmp_path / "data")
    done = export(data, tmp_path / "given", action_source=ActionSource.GIVEN)
    assert done.residual is not None
    assert done.residual.targets == 2 * HORIZON
    assert max(done.residual.max_position, done.residual.max_rotation) < 1e-4
    given = columns(tmp_path / "given")["action"]
    (recording,) = data.recordings()
    np.testing.assert_allclose(given, recording.sent, atol=0.05)
    np.testing.assert_array_equal(given[:, [7, 15]], 0.5)
    assert not np.array_equal(given, recording.sent)
    export(data, tmp_path / "sent")
    sent = columns(tmp_path / "sent")["action"]
    np.testing.assert_array_equal(sent, recording.sent.astype(np.float32))


@pytest.mark.long
@pytest.mark.parametrize("size", [20, 1000, 40_000])
def test_a_full_disk_is_said_and_crashes_nothing(tmp_path: Path, size: int) -> None:
    done = child_of(__name__, tmp_path, size)
    said, complaint = done.communicate()
    assert done.returncode == 0, complaint
    assert "Cannot write" in said
    assert not list(tmp_path.iterdir())


def fill_a_disk(folder: Path, size: int) -> None:
    """Write two videos where files grow to a number of bytes, and say the error."""
    paths = {name: folder / f"{name}.mp4" for name in "ab"}
    frame = np.random.default_rng(0).integers(0, 255, (128, 128, 3), dtype=np.uint8)
    try:
        with room(size):
            write_videos((dict.fromkeys("ab", frame) for _ in range(40)), paths, SMALL)
    except OutputError as error:
        sys.stdout.write(str(error))


# --- export of both domains ----------------------------------------------------------------------


@pytest.mark.long
def test_both_domains_are_exported_together(
    original: DataSet, real: DataSet, tmp_path: Path
) -> None:
    options = ExportOptions(size=SIZE)
    done = export_lerobot([original, real], tmp_path / "mixed", options, workers=0)
    assert (done.episodes, done.frames) == (6, EPISODES * HORIZON + sum(LENGTHS))
    folder = ExportFolder(tmp_path / "mixed")
    tables = [pq.read_table(folder.data(index)) for index in range(6)]
    assert [set(table["domain"].to_pylist()) for table in tables] == 3 * [{0}] + 3 * [{1}]
    assert tables[5]["index"][0].as_py() == EPISODES * HORIZON + sum(LENGTHS[:2])
    for index, recording in enumerate(real.recordings(), start=EPISODES):
        for place, camera in enumerate(POLICY_CAMERAS):
            shown = numbers_in(folder.video(camera, index))
            assert shown == recording.frame_number[:-1, place].tolist()
    export_lerobot([original, real], tmp_path / "again", options, workers=2)
    for path in folder.path.rglob("*.mp4"):
        other = tmp_path / "again" / path.relative_to(folder.path)
        assert other.read_bytes() == path.read_bytes()


def test_what_is_there_twice_is_exported_once(data: DataSet, tmp_path: Path) -> None:
    shutil.copytree(data.path, tmp_path / "copy")
    twice = [data, DataSet.open(tmp_path / "copy"), data]
    done = export_lerobot(twice, tmp_path / "out", replace(SMALL, cameras=()), workers=0)
    assert (done.episodes, done.left_out) == (EPISODES, 2 * EPISODES)


@pytest.mark.parametrize("split", ["train", "eval"])
def test_layouts_of_the_evaluation_are_told(data: DataSet, tmp_path: Path, split: str) -> None:
    path = data.episodes()[0]
    recording = Recording.read(path)
    replace(recording, info=replace(recording.info, split=split)).write(path)
    done = export_lerobot(data, tmp_path / "out", replace(SMALL, cameras=()), workers=0)
    assert done.eval_layouts == (split == "eval")


def test_one_domain_of_a_mixed_data_set_is_exported_alone(
    original: DataSet, real: DataSet, tmp_path: Path
) -> None:
    merge([original, real], tmp_path / "all", rename=True)
    data = DataSet.open(tmp_path / "all")
    assert len(data.episodes()) == 6
    for domain in Domain:
        options = ExportOptions(size=SIZE, cameras=("head",), domains=(domain,))
        done = export_lerobot(data, tmp_path / domain, options, workers=0)
        assert (done.episodes, done.left_out) == (3, 3)
        tables = (pq.read_table(path) for path in (tmp_path / domain / "data").rglob("*.parquet"))
        assert {row for table in tables for row in table["domain"].to_pylist()} == {
            domain is Domain.REAL
        }


def test_a_camera_that_a_rig_lacks_is_named(tmp_path: Path) -> None:
    env, _ = real_recorder(tmp_path / "data", NumberDuo(cameras=("head",)), horizon=5)
    play_real(env, 5)
    env.close()
    with pytest.raises(DataError, match="no video of the camera left_wrist; it has head"):
        export_lerobot(DataSet.open(tmp_path / "data"), tmp_path / "out", workers=0)


def test_views_resize_by_mean_and_straighten_what_was_measured() -> None:
    image = image_of(5)
    assert (resized(image, (4, 8))[0, :, 0] == image[0, ::6, 0]).all()
    about = {"driver": "rehearsal", "size": [720, 1280], "calibration": None}
    native = image_of(5, (720, 1280))
    np.testing.assert_array_equal(view_of("head", about)(native, (4, 8)), resized(native, (4, 8)))
    lens = {"fx": 700.0, "fy": 700.0, "cx": 640.0, "cy": 360.0, "pose": [0, 0, 0, 0, 0, 0, 1]}
    about |= {"calibration": lens}
    shown = view_of("head", about)(native, (72, 128))
    assert (shown != resized(native, (72, 128))).any()
    with pytest.raises(DataError, match="lens of its own"):
        plain_view("head", about)
    with pytest.raises(DataError, match="camera head is invalid"):
        view_of("head", {"driver": "file", "size": "large"})


if __name__ == "__main__":
    fill_a_disk(Path(sys.argv[1]), int(sys.argv[2]))
