"""Rewards of recordings and exports, and episodes as transitions."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq
import pytest

import duobench
from duobench.core.errors import DataError, UnknownNameError
from duobench.data import (
    DataSet,
    ExportOptions,
    ImageSource,
    Recording,
    export_lerobot,
    transitions,
)
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.rewards import rewards_of
from duobench.envs.rewards import REWARDS
from duobench.tasks import catalog
from tests.data.tools import TASK, recorded

Rows = dict[str, np.ndarray]
QUICK = "bin_sort"
"""The task of the test that runs each time."""


def rows_of(data: DataSet, out: Path, **options: Any) -> Rows:
    """The columns of the first episode of an export without images."""
    given = {"cameras": ()} | options
    export_lerobot(data, out, ExportOptions(**given), workers=0)
    table = pq.read_table(ExportFolder(out).data(0))
    return {name: np.array(table.column(name).to_pylist()) for name in table.column_names}


@pytest.fixture(scope="module")
def solved(demonstrations: Callable[..., Path]) -> DataSet:
    """An episode that an expert solved, and that went on."""
    return DataSet.open(demonstrations(QUICK))


@pytest.fixture(scope="module")
def steps(solved: DataSet) -> int:
    """The control steps until its success."""
    (recording,) = solved.recordings()
    assert recording.success_step is not None
    assert recording.success_step < len(recording)
    return recording.success_step


@pytest.mark.parametrize(
    "task",
    [
        pytest.param(name, marks=() if name == QUICK else pytest.mark.long)
        for name in catalog.names()
    ],
)
def test_rewards_are_those_of_the_environment_in_every_task(
    demonstrations: Callable[..., Path], tmp_path: Path, task: str
) -> None:
    data = DataSet.open(demonstrations(task))
    (recording,) = data.recordings()
    env = duobench.make(task, cameras=False, reward="dense")
    env.reset(options={"layout": recording.info.layout})
    paid = [env.step(sent)[1] for sent in recording.sent[: recording.steps]]
    env.close()
    dense = rewards_of(recording, "dense", ImageSource(task, cameras=()))
    np.testing.assert_allclose(dense[: recording.steps], paid, rtol=0, atol=1e-9)
    assert not dense[recording.steps :].any()
    exported = rows_of(data, tmp_path / "dense", reward="dense")["next.reward"]
    np.testing.assert_array_equal(exported, dense[: recording.steps].astype(np.float32))
    progress = rows_of(data, tmp_path / "progress")["next.reward"]
    assert progress.sum() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("reward", REWARDS)
@pytest.mark.parametrize("shift", [None, "physics-3"])
def test_an_unsolved_episode_pays_what_it_paid(
    tmp_path: Path, reward: str, shift: str | None
) -> None:
    recording = recorded(tmp_path, reward=reward, **({"shift": shift} if shift else {}))
    source = ImageSource(TASK, cameras=())
    np.testing.assert_array_equal(rewards_of(recording, reward, source), recording.reward)


@pytest.mark.parametrize("reward", ["stage", "progress", "dense"])
def test_an_episode_ends_at_success_or_pays_nothing_afterwards(
    solved: DataSet, steps: int, tmp_path: Path, reward: str
) -> None:
    short = rows_of(solved, tmp_path / "short", reward=reward)
    long = rows_of(solved, tmp_path / "long", reward=reward, after_success=True)
    (recording,) = solved.recordings()
    assert (len(short["index"]), len(long["index"])) == (steps, len(recording))
    for name in short.keys() - {"index"}:
        np.testing.assert_array_equal(short[name], long[name][:steps], err_msg=name)
    assert np.flatnonzero(short["next.done"]).tolist() == [steps - 1]
    assert np.flatnonzero(long["next.done"]).tolist() == [*range(steps - 1, len(recording))]
    assert not long["next.reward"][steps:].any()
    assert short["next.reward"][-1] > 0


@pytest.mark.parametrize("pairing", ["causal", "delayed"])
@pytest.mark.parametrize("after_success", [True, False])
def test_each_so_many_rows_hold_what_stood_in_them_and_all_that_was_paid(
    solved: DataSet, tmp_path: Path, pairing: str, after_success: bool
) -> None:
    options: dict[str, Any] = {"pairing": pairing, "after_success": after_success}
    whole = rows_of(solved, tmp_path / "whole", **options)
    third = rows_of(solved, tmp_path / "third", every=3, **options)
    for name in ("observation.state", "action", "stage"):
        np.testing.assert_array_equal(third[name], whole[name][::3], err_msg=name)
    count = len(third["index"])
    np.testing.assert_allclose(third["timestamp"], np.arange(count) / 10, rtol=1e-6)
    assert third["next.reward"].sum() == pytest.approx(1.0, abs=1e-6)
    for name in ("next.done", "next.success"):
        parts = np.split(whole[name], range(3, len(whole[name]), 3))
        assert third[name].tolist() == [bool(part.any()) for part in parts], name
    info = json.loads((tmp_path / "third" / "meta" / "info.json").read_text())
    assert (info["fps"], info["total_frames"]) == (10, count)


def test_videos_have_the_codec_and_the_rows_that_were_asked_for(
    original: DataSet, tmp_path: Path
) -> None:
    options = ExportOptions(cameras=("head",), size=(64, 64), codec="h264", every=2)  # type: ignore[arg-type]
    done = export_lerobot(original, tmp_path, options, workers=0)
    about = json.loads((tmp_path / "meta" / "info.json").read_text())
    video = about["features"]["observation.images.head"]["info"]
    assert [video[f"video.{key}"] for key in ("codec", "fps", "preset")] == [
        "h264",
        15,
        "superfast",
    ]
    recording, source = next(original.recordings()), ImageSource(TASK, cameras="head", size=64)
    with av.open(ExportFolder(tmp_path).video("head", 0)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.average_rate) == ("h264", 15)
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(frames) * len(original.episodes()) == done.frames
    images = [source.images(recording, row)["head"] for row in range(0, len(recording), 2)]
    source.close()
    errors = np.subtract(frames, images, dtype=np.float64)
    assert np.sqrt((errors**2).mean()) < 8
    assert abs(errors.mean()) < 0.5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"every": 4}, "one of 1, 2, 3, 5, 6, 10, 15, 30"),
        ({"every": 0}, "got 0"),
        ({"every": 2, "action": "cartesian_relative"}, "lead elsewhere"),
        ({"reward": "sparse"}, "Known: dense, progress, stage"),
        ({"codec": "h265"}, "h264"),
    ],
)
def test_what_cannot_be_exported_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises((DataError, UnknownNameError), match=words):
        ExportOptions(**options)


def test_dense_is_refused_where_the_stages_are_not_those_of_the_states(
    data: DataSet, tmp_path: Path
) -> None:
    path = data.episodes()[1]
    recording = Recording.read(path)
    replace(recording, stage=recording.stage + (np.arange(len(recording) + 1) > 20)).write(path)
    with pytest.raises(DataError, match=r"00001\.parquet.*at stage 1 in row 21, .* stage 0:"):
        rows_of(data, tmp_path / "out", reward="dense")
    assert rows_of(data, tmp_path / "other")["next.reward"].sum() == 0


def test_dense_is_refused_on_real_arms_before_anything_is_written(
    real: DataSet, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="played on real arms, where nothing measures"):
        rows_of(real, tmp_path / "out", reward="dense")
    assert not (tmp_path / "out").exists()
    task = real.tasks[0]
    with pytest.raises(DataError, match="played on real arms"):
        next(transitions(real, task, reward="dense"))


# --- transitions ---------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["joint", "joint_relative"])
def test_transitions_are_those_of_an_environment(solved: DataSet, steps: int, mode: str) -> None:
    (one,) = transitions(solved, QUICK, reward="dense", action_mode=mode, object_state=True)
    env = duobench.make(QUICK, cameras=False, object_state=True, reward="dense", action_mode=mode)
    seen, _ = env.reset(options={"layout": one.recording.info.layout})
    assert seen.keys() == one.observation.keys() == one.next_observation.keys()
    assert len(one.action) == len(one.reward) == steps
    assert one.action.dtype == np.float32
    for row in range(steps):
        for name, values in seen.items():
            assert values.shape == one.observation[name][row].shape
            np.testing.assert_allclose(one.observation[name][row], values, atol=0.02)
        seen, reward, terminated, _, _ = env.step(one.action[row])
        assert terminated == one.terminated[row]
        assert reward == pytest.approx(one.reward[row], abs=0.02)
        assert env.action_space.contains(one.action[row])
    env.close()
    assert not one.truncated.any()


def test_transitions_have_tool_poses_where_these_are_the_actions(solved: DataSet) -> None:
    (one,) = transitions(solved, QUICK, action_mode="cartesian")
    sides = one.action.reshape(-1, 2, 8)
    reached = one.next_observation["tcp_pose"].reshape(-1, 2, 7)
    assert np.abs(sides[..., :3] - reached[..., :3]).max() < 0.1
    np.testing.assert_allclose((sides[..., 3:7] ** 2).sum(axis=-1), 1.0, atol=1e-6)
    (recording,) = solved.recordings()
    np.testing.assert_allclose(sides[..., 7], recording.sent[: len(sides)][:, [7, 15]], atol=1e-6)


def test_an_unsolved_episode_is_truncated_and_discarded_ones_are_left_out(data: DataSet) -> None:
    path = data.episodes()[0]
    recording = Recording.read(path)
    outcome = replace(recording.info.outcome, kept=False)  # type: ignore[type-var]
    replace(recording, info=replace(recording.info, outcome=outcome)).write(path)
    found = [*transitions(data, TASK)]
    assert len(found) == len(data.episodes()) - 1
    for each in found:
        assert not each.terminated.any()
        assert np.flatnonzero(each.truncated).tolist() == [len(each.action) - 1]
        np.testing.assert_array_equal(
            each.observation["agent_pos"][1:], each.next_observation["agent_pos"][:-1]
        )
