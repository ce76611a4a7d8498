from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import duobench
from duobench.cli import main
from duobench.core.errors import DataError, OptionError, UnknownNameError
from duobench.data import DataSet, ImageSource, Recording, find_problems
from duobench.evaluation.replay import replay
from duobench.tasks import catalog
from tests.data.tools import TASK, only, recorded, recorder
from tests.envs.tools import wave


@pytest.fixture(scope="module")
def demos(demonstrations: Callable[..., Path]) -> Path:
    return demonstrations(TASK)


@pytest.fixture(scope="module")
def expert(demos: Path) -> Recording:
    return only(demos)


@pytest.mark.slow
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


@pytest.mark.parametrize("shift", ["physics-3", "layout-3", "look-3"])
def test_shifted_episodes_are_replayed_and_have_no_problem(tmp_path: Path, shift: str) -> None:
    env = recorder(tmp_path, shift=shift)
    env.reset(seed=3)
    for number in range(8):
        env.step(wave(number))
    env.close()
    (found,) = replay(TASK, [only(tmp_path)])
    assert found.is_exact
    assert find_problems(DataSet.open(tmp_path), workers=0) == []


def test_a_changed_command_and_other_stages_are_found(expert: Recording) -> None:
    sent, stage = expert.sent.copy(), expert.stage.copy()
    sent[30, 0] += 1e-6
    stage[5:] = np.maximum(stage[5:], 1)
    moved, staged = replay(TASK, [replace(expert, sent=sent), replace(expert, stage=stage)])
    assert (moved.first, moved.is_exact) == (31, False)
    assert 0.0 < moved.largest < 0.1
    assert (staged.first, staged.same_stages, staged.is_exact) == (None, False, False)


def other(recording: Recording, **changes: Any) -> Recording:
    return replace(recording, info=replace(recording.info, **changes))


@pytest.mark.parametrize(
    ("task", "change", "message"),
    [
        ("ball_maze", other, "of task 'bin_sort', not of 'ball_maze'"),
        (TASK, lambda one: other(one, suite_version="1"), "suite 1"),
        (TASK, lambda one: other(one, layout={"poses": {}, "variants": {}}), "cannot be begun"),
        (TASK, lambda one: replace(one, sent=np.full_like(one.sent, np.nan)), "cannot be replayed"),
    ],
)
def test_what_cannot_be_replayed_is_said(
    expert: Recording, task: str, change: Callable[[Recording], Recording], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        next(replay(task, [change(expert)]))


def test_an_episode_longer_than_the_horizon_is_replayed(tmp_path: Path) -> None:
    rows = recorded(tmp_path, steps=230, horizon=230)
    assert len(rows) > catalog.get(TASK).horizon
    assert next(replay(TASK, [other(rows, config=None)])).is_exact


def test_images_of_states_are_those_of_the_environment(expert: Recording) -> None:
    source = ImageSource(TASK, cameras=("head", "left_wrist"), size=(48, 64))
    env = duobench.make(TASK, cameras=("head", "left_wrist"), image_size=(48, 64))
    first, _ = env.reset(options={"layout": expert.info.layout})
    observation = first
    for row in range(25):
        np.testing.assert_equal(source.images(expert, row), observation["pixels"])
        observation, *_ = env.step(expert.sent[row])
    with pytest.raises(DataError, match=r"Row 3 .* cannot be shown"):
        source.images(replace(expert, state=expert.state[:, :-1]), 3)
    for row in (-1, len(expert.state)):
        with pytest.raises(DataError, match=rf"has states 0 to {len(expert.state) - 1}, not {row}"):
            source.images(expert, row)
    poses = {**expert.info.layout["poses"], "white_bowl": [float("nan")] * 7}
    with pytest.raises(DataError, match="cannot be shown"):
        source.images(other(expert, layout={"poses": poses, "variants": {}}), 0)
    np.testing.assert_equal(source.images(expert, 0), first["pixels"])  # as if nothing had been
    source.close()
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("task", [TASK, "duobench.tasks.bin_sort:TASK"])
def test_the_command_replays_a_task_by_any_of_its_names(
    demos: Path, tmp_path: Path, task: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["replay", str(demos), "--mode", "actions", "--tasks", task])
    assert capsys.readouterr().out.splitlines()[3].split("│")[2].strip() == "1"
    words = ["--tasks", task, "--out", str(tmp_path), "--cameras", "head", "--size", "16", "16"]
    main(["replay", str(demos), *words])
    assert [*tmp_path.rglob("*.webm")] == [tmp_path / TASK / "00000.webm"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--mode states --tasks ball_maze", "Unknown task in the data set 'ball_maze'"),
        ("--mode actions --tasks ball_maze", "Unknown task in the data set 'ball_maze'"),
        ("--cameras", "at least one camera"),
        ("--size 3 4", "--size is 3 4"),
    ],
)
def test_the_command_says_what_there_is_not(demos: Path, words: str, message: str) -> None:
    with pytest.raises(SystemExit, match=message):
        main(["replay", str(demos), *words.split()])


def test_images_take_one_camera_and_squares_and_no_other_size(expert: Recording) -> None:
    source = ImageSource(TASK, cameras="head", size=16)
    assert source.images(expert, 0)["head"].shape == (16, 16, 3)
    source.close()
    for size in ((8, 8, 8), ("a", "b"), (0, 3)):
        with pytest.raises(OptionError, match="one number for a square"):
            ImageSource(TASK, size=size)  # type: ignore[arg-type]
    for kind in ("depth", "segmentation"):
        for names in (None, 3, {"head"}):
            with pytest.raises(OptionError, match=f"{kind} is a name, or a list of names"):
                ImageSource(TASK, **{kind: names})  # type: ignore[arg-type]
        with pytest.raises(UnknownNameError, match="'head'"):
            ImageSource(TASK, **{kind: "haed"})


def test_depth_and_parts_of_states_are_those_of_the_environment(expert: Recording) -> None:
    """From every camera, also the one for people and one's own, in the same state."""
    side = duobench.Camera(name="side", position=(0.5, 1.2, 0.5), look_at=(0.5, 0.0, 0.0), size=24)
    seen: Any = {"cameras": ("head", side), "depth": True, "segmentation": "left_wrist"}
    source = ImageSource(TASK, size=(48, 64), **seen)
    env = duobench.make(TASK, image_size=(48, 64), **seen)
    observation, _ = env.reset(options={"layout": expert.info.layout})
    for row in range(3):
        shown = source.images_by_kind(expert, row)
        for kind, key in (("rgb", "pixels"), ("depth", "depth"), ("segmentation", "segmentation")):
            np.testing.assert_equal(shown[kind], observation[key])
        for name, placed in source.geometry(expert, row).items():
            there = env.get_wrapper_attr("cameras")[name]
            np.testing.assert_array_equal(placed.matrix, there.matrix)
            np.testing.assert_array_equal(placed.table_from_camera, there.table_from_camera)
        observation, *_ = env.step(expert.sent[row])
    env.close()
    source.close()
    people = ImageSource(TASK, cameras="overview", size=(48, 64), depth=True)
    assert people.images_by_kind(expert, 0)["depth"]["overview"].max() > 1.0
    people.close()
