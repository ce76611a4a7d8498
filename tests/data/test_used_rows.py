"""Which rows of a recording are used, where an operator led now and then."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

import duobench
from duobench.cli import main
from duobench.core.errors import OtherRunError
from duobench.core.types import SIDES, Array
from duobench.data import (
    Actor,
    ActorKind,
    DataSet,
    ImageSource,
    Recorder,
    Recording,
    RowChoice,
    transitions,
)
from duobench.data.arrange import merge
from duobench.data.lerobot.export import Exported, export_lerobot
from duobench.data.lerobot.folder import ExportFolder
from duobench.data.lerobot.options import ExportOptions, Format
from duobench.data.rewards import rewards_of
from duobench.data.used_rows import Reason, UsedRows, used_rows
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from tests.data.real.number_duo import SIZE, numbers_in, real_recorder
from tests.data.test_lerobot import columns, files, frames
from tests.data.tools import TASK, only
from tests.quick_first import quick_first

PERSON = Actor(kind=ActorKind.PERSON, name="P07", device="headset")
PHASES, LED, THINKING = 4, 20, 150
SETTLING = 12
"""Rows at most in which arms still move after a hand let go."""
TINY = ExportOptions(cameras=("head",), size=(32, 48), object_state=True, keep_failures=True)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    """An episode as people recorded it while time ran on: one leads, and thinks, and leads."""
    folder = tmp_path_factory.mktemp("people") / "session"
    made = duobench.make(TASK, cameras=False, horizon=9999, action_mode="cartesian")
    env, kinematics = Recorder(made, folder, PERSON, has_clutch=True), Kinematics(ROBOT)
    env.reset(seed=0)
    for phase in range(PHASES):
        for step in range(THINKING + LED):
            leads = step >= THINKING
            tools = kinematics.forward(env.base.backend.last_command.joints)
            lift = 0.004 * leads * (-1) ** phase
            opening = 0.4 if phase > 1 else 1.0
            action = [np.append(tools[side].moved(0, 0, lift).tquat, opening) for side in SIDES]
            env.clutch = (leads, False)
            env.step(np.ravel(action))
    env.finish(cut=False)
    env.close()
    return DataSet.open(folder)


@pytest.fixture
def spoiled(session: DataSet, tmp_path: Path) -> Callable[..., DataSet]:
    """Makes a copy of the session with other columns."""

    def make(**changes: Array) -> DataSet:
        merge([session], tmp_path / "spoiled")
        data = DataSet.open(tmp_path / "spoiled")
        (path,) = data.episodes()
        replace(Recording.read(path), **changes).write(path)
        return data

    return make


@pytest.fixture(scope="module")
def exported(session: DataSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("export") / "out"
    export_lerobot(session, out, TINY, workers=0)
    return out


def export(data: DataSet, out: Path, **options: Any) -> Exported:
    """An export without images, unless cameras are among the options."""
    return export_lerobot(data, out, replace(TINY, **{"cameras": (), **options}), workers=0)


def steps_of(poses: NDArray[Any]) -> Array:
    """How far each number moves in a step."""
    return np.abs(np.diff(poses.astype(float), axis=0))


def test_rows_in_which_nobody_led_and_nothing_moved_are_left_out(
    session: DataSet, exported: Path
) -> None:
    recording, rows = only(session.path), columns(exported)
    kept = rows["recording_row"]
    led = np.flatnonzero(recording.clutch.any(axis=1))
    assert set(led) <= set(kept)
    assert len(kept) < PHASES * (LED + SETTLING)
    source = ImageSource(TASK, cameras=())
    objects = np.array([source.objects(recording, row) for row in range(len(recording))])
    whole = np.hstack([recording.agent_pos[:-1], recording.tcp_pose[:-1], objects])
    # No row that stands still, or in which arms settle, and no pose that jumps where rows are
    # missing.
    idle = (steps_of(whole[kept[0] :]).max(axis=1) < 5e-4)[kept[:-1] - kept[0]]
    is_told = (steps_of(recording.sent) > 1e-4).any(axis=1)[kept[1:-1] - 1]
    assert not (idle & ~recording.clutch[kept[:-1]].any(axis=1))[1:][~is_told].any()
    joints = recording.agent_pos.shape[1]
    parts = [
        *range(joints),
        *range(joints, whole.shape[1], 7),
        *range(joints + 3, whole.shape[1], 7),
    ]
    largest, seams = (
        np.maximum.reduceat(steps_of(each).max(axis=0), sorted(parts))  # of places and rotations
        for each in (whole, whole[kept])
    )
    assert (seams <= largest + 1e-4).all()
    np.testing.assert_array_equal(rows["observation.state"], recording.agent_pos[kept])
    np.testing.assert_array_equal(rows["observation.environment_state"], objects[kept])
    np.testing.assert_array_equal(rows["action"], recording.sent[kept].astype(np.float32))
    np.testing.assert_array_equal(rows["timestamp"], (np.arange(len(kept)) / 30).astype("f4"))
    assert rows["next.done"].tolist() == [False] * (len(kept) - 1) + [True]
    # The command before rows that are missing is that of all of them.
    for last, following in pairwise(kept):
        assert np.abs(recording.sent[last:following] - recording.sent[last]).max() < 2e-5


def test_videos_hold_the_rows_that_are_used(session: DataSet, exported: Path) -> None:
    recording, kept = only(session.path), columns(exported)["recording_row"]
    source = ImageSource(TASK, cameras=("head",), size=TINY.size)
    shown = frames(ExportFolder(exported).video("head", 0))
    assert len(shown) == len(kept)
    for place in (0, LED + 5, len(kept) - 1):
        expected = source.images(recording, kept[place])["head"].astype(float)
        others = [np.abs(image - expected).mean() for image in shown]
        assert others[place] < 1.5 * min(others)
    source.close()


def test_each_row_names_its_recording(session: DataSet, exported: Path, tmp_path: Path) -> None:
    (path,) = session.episodes()
    export(session, tmp_path / "v21", format=Format.V21)
    table = pq.read_table(exported / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    lines = (tmp_path / "v21/meta/episodes.jsonl").read_text()
    name = path.relative_to(session.path).as_posix()
    assert table[0]["recording"] == name
    assert f'"recording": "{name}"' in lines
    assert table[0]["recording_sha256"] in lines


def test_an_operator_is_told_and_may_keep_them(
    session: DataSet, exported: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    length, used = len(only(session.path)), len(columns(exported)["index"])
    words = [
        "export",
        "lerobot",
        str(session.path),
        "--keep-failures",
        "--cameras",
        "none",
        "--out",
    ]
    main([*words, str(tmp_path / "out")])
    assert f"Left out: {length - used} rows in which nobody led" in capsys.readouterr().out
    main([*words, str(tmp_path / "all"), "--keep-idle"])
    assert "Left out" not in capsys.readouterr().out
    assert columns(tmp_path / "all")["recording_row"].tolist() == list(range(length))
    main(["data", "info", str(session.path), "--no-images"])
    assert f"nothing moved in {length - used} of {length} rows" in " ".join(
        capsys.readouterr().out.split()
    )
    before = files(tmp_path / "out")
    with pytest.raises(OtherRunError, match="keep_idle True instead of False"):
        export(session, tmp_path / "out", object_state=False, size=224, keep_idle=True)
    ExportFolder(tmp_path / "out").data(0).unlink()
    main([*words, str(tmp_path / "out")])
    assert files(tmp_path / "out") == before


@pytest.mark.parametrize("every", quick_first([3, 1]))
@pytest.mark.parametrize("reward", ["stage", "progress", "dense"])
def test_rewards_add_up_to_what_they_did(
    spoiled: Callable[..., DataSet], tmp_path: Path, session: DataSet, reward: str, every: int
) -> None:
    """A stage that is reached while nobody leads, as where something has to rest, is kept."""
    recording, data = only(session.path), session
    reached = THINKING // 2
    if reward != "dense":  # which judges the states
        stage = recording.stage.copy()
        stage[reached + 1 :] = 2
        data = spoiled(stage=stage)
    export(data, tmp_path / "out", reward=reward, every=every)
    rows = columns(tmp_path / "out")
    source = ImageSource(TASK, cameras=()) if reward == "dense" else None
    paid = rewards_of(only(data.path), reward, source)
    kept = rows["recording_row"]
    bounds = [0, *kept[1:], len(paid)]
    wanted = [paid[one:other].sum() for one, other in pairwise(bounds)]
    np.testing.assert_allclose(rows["next.reward"], wanted, rtol=1e-6, atol=1e-9)
    assert source is not None or kept[0] == reached


@pytest.mark.parametrize("rate", [1e-6, 1e-5, 6e-5, 2e-3])
def test_a_drift_keeps_as_many_rows_as_it_needs(
    spoiled: Callable[..., DataSet], session: DataSet, rate: float
) -> None:
    """An object that creeps, rolls or falls while nobody leads; metres a row."""
    state = only(session.path).state.copy()
    model = ImageSource(TASK, cameras=()).simulation.model
    place = 1 + int(model.joint("white_cube").qposadr[0]) + 1  # y, behind the time and x
    moving = slice(40, 40 + 100)
    state[moving, place] += rate * np.arange(100)
    state[moving.stop :, place] += rate * 99
    recording = only(spoiled(state=state).path)
    rows = used_rows(recording, RowChoice(), TASK).steps()
    y = recording.state[:, place]
    largest = 1e-4 + steps_of(recording.state[:, place - 1 : place + 2]).max()
    assert np.abs(y[rows.ends] - y[rows.rows]).max() <= 1.01 * largest
    added = len(rows) - len(used_rows(only(session.path), RowChoice(), TASK).steps())
    assert added >= (98 if rate > 1e-4 else int(99 * rate / largest) - 1)


def test_relative_actions_lead_all_the_way(session: DataSet, tmp_path: Path) -> None:
    recording = only(session.path)
    export(session, tmp_path / "all", action="cartesian_relative", keep_idle=True)
    export(session, tmp_path / "out", action="cartesian_relative")
    whole, used = (columns(tmp_path / name)["action"] for name in ("all", "out"))
    moves = [0, 1, 2, 10, 11, 12]
    np.testing.assert_allclose(
        used[:, moves].sum(axis=0), whole[:, moves].sum(axis=0), rtol=0, atol=1e-5
    )
    (one,) = transitions(session, TASK, action_mode="joint_relative")
    (all_of_it,) = transitions(
        session, TASK, action_mode="joint_relative", choice=RowChoice(keep_idle=True)
    )
    joints = [*range(7), *range(8, 15)]
    np.testing.assert_allclose(
        one.action[:, joints].sum(axis=0), all_of_it.action[:, joints].sum(axis=0), atol=1e-5
    )
    np.testing.assert_array_equal(
        one.next_observation["agent_pos"][:-1], one.observation["agent_pos"][1:]
    )
    np.testing.assert_array_equal(one.observation["tcp_pose"], recording.tcp_pose[one.rows])
    assert one.truncated.tolist() == [False] * (len(one.rows) - 1) + [True]


def test_images_of_real_arms_are_those_of_the_rows_that_are_used(tmp_path: Path) -> None:
    env, duo = real_recorder(tmp_path / "data", horizon=200, has_clutch=True)
    observation, _ = env.reset()
    target = observation["agent_pos"].astype(float)
    for step in range(200):
        leads = step % 100 >= 90
        env.clutch = (False, leads)
        target[0] += 0.01 * leads
        env.step(target)
    env.close()
    data = DataSet.open(tmp_path / "data")
    options = ExportOptions(size=SIZE, cameras=("head",))
    export_lerobot(data, tmp_path / "out", options, workers=0)
    rows, recording = columns(tmp_path / "out"), only(data.path)
    assert rows["recording_row"].tolist() == [*range(90, 100), *range(190, 200)]
    shown = numbers_in(ExportFolder(tmp_path / "out").video("head", 0))
    assert shown == recording.frame_number[rows["recording_row"], 0].tolist()
    assert duo is not None


def test_steps_stand_for_idle_rows_and_begin_anew_behind_others() -> None:
    used = UsedRows(spans=((2, 4), (6, 8), (10, 13)), idle=((0, 2), (4, 6), (13, 15)))
    steps = used.steps()
    assert steps.rows.tolist() == [2, 3, 6, 7, 10, 11, 12]
    assert steps.starts.tolist() == [0, 3, 6, 7, 10, 11, 12]
    assert steps.ends.tolist() == [3, 6, 7, 8, 11, 12, 15]
    assert steps.before.tolist() == [1, 2, 3, 6, 9, 10, 11]
    assert steps.added(np.ones(15)).tolist() == [3, 3, 1, 1, 1, 1, 3]
    coarse = used.steps(3)
    assert coarse.rows.tolist() == [2, 7, 10]
    assert coarse.ends.tolist() == [7, 8, 15]
    assert not len(UsedRows.every(0).steps())


def test_a_review_leaves_rows_and_an_idle_episode_none(
    spoiled: Callable[..., DataSet], session: DataSet, tmp_path: Path
) -> None:
    recording = only(session.path)
    used = used_rows(recording, RowChoice(keep_idle=True), TASK, within=(10, 500))
    assert used.spans == ((10, 500),)
    assert used.left_out == {Reason.TRIMMED: len(recording) - 490}
    used = used_rows(recording, RowChoice(), TASK, within=(10, THINKING - 10))
    assert not used.spans
    still = {name: getattr(recording, name).copy() for name in ("clutch", "sent", "state")}
    still["clutch"][:] = False
    still["sent"][:], still["state"][:] = still["sent"][0], still["state"][0]
    for name in ("agent_pos", "tcp_pose"):
        still[name] = np.repeat(getattr(recording, name)[:1], len(recording) + 1, axis=0)
    idle = spoiled(**still)
    assert not [*transitions(idle, TASK)]
    merge([session, idle], tmp_path / "both", rename=True)
    done = export(DataSet.open(tmp_path / "both"), tmp_path / "out")
    assert (done.episodes, done.left_out) == (1, 1)
