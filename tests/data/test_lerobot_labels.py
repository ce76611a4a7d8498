"""Exports without images: object states, and actions that are tool poses; what they play."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import duobench
from duobench.cli import main
from duobench.core.errors import ActionError, DataError, PolicyError, SeveralTasksError
from duobench.core.randomness import SUITE_VERSION
from duobench.core.spatial import SE3, product
from duobench.data import ActionSource, DataSet, ExportOptions, Recording, export_lerobot
from duobench.data.arrange import merge
from duobench.data.lerobot.actions import labels_of
from duobench.data.lerobot.folder import ExportFolder
from duobench.envs import action_labels
from duobench.envs.action_labels import LABELS, POSE_LABELS, rotations_from_columns
from duobench.envs.config import LAYOUT
from duobench.policy import lerobot_checkpoint as labels
from tests.data.conftest import EPISODES
from tests.data.tools import HORIZON, TASK, recorder

SHORT_TASK = "carry_pot"
TOOLS = ("cartesian", "cartesian_relative")


@pytest.fixture(scope="module")
def data(demonstrations: Callable[..., Path]) -> DataSet:
    """A whole episode of the expert, to read only."""
    return DataSet.open(demonstrations(SHORT_TASK, variety="none"))


def rows(folder: Path, column: str) -> np.ndarray:
    table = pq.read_table(ExportFolder(folder).data(0))
    return np.array(table.column(column).to_pylist(), dtype=np.float32)


def feature(folder: Path, name: str) -> dict:
    return json.loads((folder / "meta/info.json").read_text())["features"][name]


def test_object_states_are_those_that_an_environment_shows(data: DataSet, tmp_path: Path) -> None:
    main([
        "export", "lerobot", str(data.path), "--out", str(tmp_path / "out"),
        "--cameras", "none", "--object-state", "--per-task", "--workers", "0",
    ])  # fmt: skip
    out, name = tmp_path / "out" / SHORT_TASK, "observation.environment_state"
    exported, (recording,) = rows(out, name), data.recordings()
    env = duobench.make(SHORT_TASK, cameras=False, object_state=True)
    observation, _ = env.reset(options={LAYOUT: recording.info.layout})
    for row in range(recording.steps):
        np.testing.assert_array_equal(exported[row], observation["environment_state"])
        observation, *_ = env.step(recording.sent[row])
    names = env.get_wrapper_attr("object_state_names")
    assert feature(out, name) == {"dtype": "float32", "shape": [len(names)], "names": [*names]}
    stats = json.loads((out / "meta/stats.json").read_text())
    np.testing.assert_allclose(stats[name]["max"], exported.max(axis=0))
    assert not (out / "videos").exists()


def test_object_states_of_several_tasks_need_a_folder_each(
    data: DataSet, original: DataSet, tmp_path: Path
) -> None:
    merge([data, original], tmp_path / "both")
    both = DataSet.open(tmp_path / "both")
    out, options = tmp_path / "out", ExportOptions(cameras=(), object_state=True)
    with pytest.raises(SeveralTasksError, match="bin_sort, carry_pot"):
        export_lerobot(both, out, options, workers=0)
    assert not out.exists()
    with pytest.raises(SystemExit, match="--per-task"):
        main(["export", "lerobot", str(both.path), "--out", "out", "--object-state"])
    done = export_lerobot(both, out, options, per_task=True, workers=0)
    assert done.episodes == 1 + EPISODES
    for task, episodes in ((SHORT_TASK, 1), (TASK, EPISODES)):
        info = json.loads((out / task / "meta/info.json").read_text())
        assert info["total_episodes"] == episodes


@pytest.mark.parametrize("mode", TOOLS)
def test_an_exported_episode_plays_as_a_checkpoint_would(
    data: DataSet, tmp_path: Path, mode: str
) -> None:
    out, checkpoint = tmp_path / "out", tmp_path / "checkpoint"
    export_lerobot(data, out, ExportOptions(cameras=(), action=mode), workers=0)
    learned = rows(out, "action")
    checkpoint.mkdir()
    settings = {"dataset": {"root": str(out)}}
    (checkpoint / "train_config.json").write_text(json.dumps(settings))
    mapping = labels.labels_of(checkpoint, learned.shape[1])
    assert mapping.mode.name == mode

    (recording,) = data.recordings()
    env = duobench.make(SHORT_TASK, cameras=False, action_mode=mode)
    _, info = env.reset(options={LAYOUT: recording.info.layout})
    stages = [info["stage"]]
    for action in mapping.to_actions(learned):
        *_, info = env.step(action)
        stages.append(info["stage"])
        if info["success"]:
            break
    env.close()
    assert info["success"]
    assert list(dict.fromkeys(stages)) == list(dict.fromkeys(recording.stage.tolist()))


def test_a_relative_label_leads_from_what_was_sent_to_what_was_meant(data: DataSet) -> None:
    (recording,) = data.recordings()
    meant, _ = labels_of(recording, "cartesian", ActionSource.INTENDED)
    sent, _ = labels_of(recording, "cartesian", ActionSource.SENT)
    change, _ = labels_of(recording, "cartesian_relative", ActionSource.INTENDED)
    for row in (1, len(recording) // 2):
        (before,), (after,), (step,) = (
            [side.reshape(2, 10)[0] for side in rows]
            for rows in (sent[row - 1 : row], meant[row : row + 1], change[row : row + 1])
        )
        np.testing.assert_allclose(before[:3] + step[:3], after[:3], atol=1e-12)
        turned, start, end = (
            rotations_from_columns(numbers[None, 3:9])[0] for numbers in (step, before, after)
        )
        np.testing.assert_allclose(product(turned, start), end, atol=1e-12)


@pytest.mark.parametrize("mode", TOOLS)
def test_actions_that_were_given_in_the_mode_come_back_as_they_were(
    tmp_path: Path, mode: str
) -> None:
    env = recorder(tmp_path, action_mode=mode)
    env.action_space.seed(0)
    observation, _ = env.reset(seed=0)
    for _ in range(HORIZON):
        action = env.action_space.sample()
        if mode == "cartesian":
            action = np.insert(observation["tcp_pose"], [7, 14], action[[7, 15]])
        observation, *_ = env.step(action)
    env.close()
    (recording,) = DataSet.open(tmp_path).recordings()
    given, _ = labels_of(recording, mode, ActionSource.INTENDED)
    actions = LABELS[mode].to_actions(given)
    if mode == "cartesian":
        for one, other in zip(actions, recording.action, strict=True):
            for start in (0, 8):
                ends = (SE3.from_tquat(row[start : start + 7]) for row in (one, other))
                assert max(next(ends).distance(next(ends))) < 1e-6
    else:
        np.testing.assert_allclose(actions, recording.action, atol=1e-6)
    sent, _ = labels_of(recording, mode, ActionSource.SENT)
    assert sent.shape == given.shape
    assert not np.allclose(sent, given)


def test_six_numbers_of_a_rotation_may_be_any_two_columns() -> None:
    rng = np.random.default_rng(0)
    rotations = rotations_from_columns(rng.normal(size=(50, 6)))
    np.testing.assert_allclose(
        rotations @ rotations.swapaxes(1, 2), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    for columns in ([0, 0, 0, 0, 1, 0], [1, 0, 0, 2, 0, 0]):
        with pytest.raises(ActionError, match="first two columns"):
            rotations_from_columns(np.array([columns], dtype=float))


def test_names_say_what_actions_are() -> None:
    for mode in duobench.envs.ACTION_MODES.values():
        found = action_labels.find(mode.names)
        assert found is not None
        assert found.mode == mode
    assert action_labels.find(POSE_LABELS[::-1]) is None


def test_a_checkpoint_whose_actions_are_not_known_is_rejected(tmp_path: Path) -> None:
    assert labels.labels_of(tmp_path, 16).mode.name == "joint"
    assert labels.labels_of(tmp_path, 20, "cartesian").names == POSE_LABELS
    for size, mode, message in ((20, None, "nothing says what"), (16, "cartesian", "16 numbers")):
        with pytest.raises(PolicyError, match=message):
            labels.labels_of(tmp_path, size, mode)
    for names, message in ((["x", "y"], "no action mode has"), ([*POSE_LABELS], "its data set 20")):
        (tmp_path / "duobench_names.json").write_text(json.dumps({"action": names}))
        with pytest.raises(PolicyError, match=message):
            labels.labels_of(tmp_path, 16)


def test_real_episodes_have_no_object_states_and_other_suites_are_not_exported(
    real: DataSet, example: Recording, tmp_path: Path
) -> None:
    options = ExportOptions(cameras=(), object_state=True)
    with pytest.raises(DataError, match="real table"):
        export_lerobot(real, tmp_path / "out", options, workers=0)
    other = DataSet.open(tmp_path / "other")
    old = replace(example, info=replace(example.info, suite_version="4"))
    old.write(other.episode(TASK, "00000"))
    message = f"is of suite 4; this version exports suite {SUITE_VERSION}"
    with pytest.raises(DataError, match=message):
        export_lerobot(other, tmp_path / "out", ExportOptions(cameras=()), workers=0)
