from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import duobench
from duobench.cli import main
from duobench.data import DataSet, ImageSource, Recording
from duobench.errors import DataError
from duobench.replay import replay
from duobench.results.suite import find_tasks
from duobench.runners.demonstrations import record
from duobench.tasks import catalog
from tests.data.tools import TASK, only, recorded, recorder
from tests.envs.tools import wave


@pytest.fixture(scope="module")
def expert(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    data = DataSet.open(tmp_path_factory.mktemp("data"))
    record("expert", find_tasks([TASK]), data, episodes=1, workers=0)
    return Recording.read(data.episodes()[0])


def test_commands_lead_to_the_same_states_and_stages(expert: Recording) -> None:
    (found,) = replay(TASK, [expert])
    assert found.is_exact
    assert found.steps == len(expert) == (expert.success_step or 0) + 30
    assert found.stage == found.recorded_stage == expert.stage.max() > 0
    assert found.largest == 0.0


@pytest.mark.parametrize(
    "options", [{"action_mode": "cartesian_relative"}, {"binary_gripper": True}, {"chunk": None}]
)
def test_commands_of_any_action_mode_are_replayed(tmp_path: Path, options: dict[str, Any]) -> None:
    env = recorder(tmp_path, **options)
    env.reset(seed=2)
    for number in range(20):
        relative = np.full(14, 0.01 * np.sin(number))
        env.step(relative if "action_mode" in options else wave(number))
    env.close()
    (found,) = replay(TASK, [only(tmp_path)])
    assert found.is_exact


def test_a_changed_command_is_found_where_it_is(expert: Recording) -> None:
    sent = expert.sent.copy()
    sent[30, 0] += 1e-6
    (found,) = replay(TASK, [replace(expert, sent=sent)])
    assert found.first == 31
    assert 0.0 < found.largest < 0.1
    assert not found.is_exact


def test_stages_that_do_not_come_out_the_same_are_said(expert: Recording) -> None:
    stage = expert.stage.copy()
    stage[5:] = np.maximum(stage[5:], 1)
    (found,) = replay(TASK, [replace(expert, stage=stage)])
    assert found.first is None
    assert not found.same_stages
    assert not found.is_exact


@pytest.mark.parametrize(
    ("task", "changes", "message"),
    [
        ("ball_maze", {}, "of task 'bin_sort', not of 'ball_maze'"),
        (TASK, {"suite_version": "1"}, "suite 1"),
        (TASK, {"layout": {"poses": {}, "variants": {}}}, "cannot be begun"),
    ],
)
def test_what_cannot_be_replayed_is_said(
    expert: Recording, task: str, changes: dict[str, Any], message: str
) -> None:
    changed = replace(expert, info=replace(expert.info, **changes))
    with pytest.raises(DataError, match=message):
        next(replay(task, [changed]))


def test_images_of_states_are_those_of_the_environment(expert: Recording) -> None:
    source = ImageSource(TASK, cameras=("head", "left_wrist"), size=(48, 64))
    env = duobench.make(TASK, cameras=("head", "left_wrist"), image_size=(48, 64))
    observation, _ = env.reset(options={"layout": expert.info.layout})
    for row in range(25):
        shown = source.images(expert, row)
        for camera, image in observation["pixels"].items():
            np.testing.assert_array_equal(shown[camera], image)
        observation, *_ = env.step(expert.sent[row])
    foreign = replace(expert, state=expert.state[:, :-1])
    with pytest.raises(DataError, match=r"Row 3 .* cannot be shown"):
        source.images(foreign, 3)
    source.close()
    env.close()


def test_an_episode_longer_than_the_horizon_is_replayed(tmp_path: Path) -> None:
    rows = recorded(tmp_path, steps=230, horizon=230)
    assert len(rows) > catalog.get(TASK).horizon
    by_hand = replace(rows, info=replace(rows.info, config=None))
    assert next(replay(TASK, [by_hand])).is_exact


def test_commands_that_are_no_numbers_are_said(expert: Recording) -> None:
    with pytest.raises(DataError, match="cannot be replayed"):
        next(replay(TASK, [replace(expert, sent=np.full_like(expert.sent, np.nan))]))


@pytest.fixture
def folder(expert: Recording, tmp_path: Path) -> Path:
    data = DataSet.open(tmp_path / "demos")
    expert.write(data.episode(TASK, "00000"))
    return data.path


@pytest.mark.parametrize("task", [TASK, "duobench.tasks.bin_sort:TASK"])
def test_the_command_replays_a_task_by_any_of_its_names(
    folder: Path, task: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["replay", str(folder), "--mode", "actions", "--tasks", task])
    assert capsys.readouterr().out.splitlines()[3].split("│")[2].strip() == "1"
    out = folder.parent / "videos"
    words = ["--tasks", task, "--out", str(out), "--cameras", "head", "--size", "16", "16"]
    main(["replay", str(folder), *words])
    assert [*out.rglob("*.webm")] == [out / TASK / "00000.webm"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--mode states --tasks ball_maze", "Unknown task in the data set 'ball_maze'"),
        ("--mode actions --tasks ball_maze", "Unknown task in the data set 'ball_maze'"),
        ("--cameras", "at least one camera"),
    ],
)
def test_the_command_says_what_there_is_not(folder: Path, words: str, message: str) -> None:
    with pytest.raises(SystemExit, match=message):
        main(["replay", str(folder), *words.split()])


def test_a_layout_that_cannot_be_shown_does_not_spoil_the_next_images(expert: Recording) -> None:
    source = ImageSource(TASK, cameras=("head",), size=(48, 64))
    before = source.images(expert, 0)["head"]
    poses = dict(expert.info.layout["poses"])
    poses["white_bowl"] = [float("nan")] * 7
    broken = replace(expert, info=replace(expert.info, layout={"poses": poses, "variants": {}}))
    with pytest.raises(DataError, match="cannot be shown"):
        source.images(broken, 0)
    np.testing.assert_array_equal(source.images(expert, 0)["head"], before)
    source.close()
