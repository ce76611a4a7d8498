"""What can be viewed: tasks, data sets and runs, down to where every body is.

A run may be followed while others write it: what its records add up to, and its report at the end.
"""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import DataError, EvaluationError, OptionError, UnknownNameError
from duobench.core.types import OPENING_SLOTS, DuoCommand
from duobench.data import DataSet, Recording
from duobench.envs.config import LAYOUT_SEED
from duobench.envs.sim_env import SimEnv
from duobench.evaluation.replay.sources import (
    DataSource,
    FollowedRun,
    RunSource,
    TaskSource,
    open_view,
)
from duobench.evaluation.replay.viewer import Viewer
from duobench.results.bundle import write_bundle
from duobench.results.folder import RunFolder, RunReader
from duobench.results.scores import wilson_interval
from duobench.tasks import catalog
from duobench.web.geometry import Geometry
from duobench.web.server import PageServer
from duobench.world.robot.cameras import HEAD_POSITION, POLICY_CAMERAS, Camera, view_from
from duobench.world.sim.simulation import Simulation
from tests.data.real.number_duo import play_real, real_recorder
from tests.data.tools import HORIZON, TASK, play, recorded, recorder
from tests.evaluation import toy_tasks
from tests.web.pages import get
from tests.web.scene_file import read_scene

MILLIMETRE = 1e-3


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "waved"
    recorded(folder)
    return folder


@pytest.fixture
def opened() -> Iterator[Callable[..., Any]]:
    with ExitStack() as ending:
        yield lambda *words, **options: ending.enter_context(closing(open_view(*words, **options)))


def test_a_task_is_shown_as_its_reset_leaves_it(opened):
    source = opened("bin_sort")
    assert isinstance(source, TaskSource)
    third = source.load("3")
    with closing(SimEnv(catalog.get("bin_sort"))) as env:
        _, info = env.reset(options={LAYOUT_SEED: 3})
        geometry = Geometry(env.simulation.model)
        np.testing.assert_allclose(
            third.poses()[0, :, :3], geometry.poses(env.simulation.data)[:, :3], atol=MILLIMETRE
        )
    assert third.instruction == info["instruction"]
    assert third.scene == geometry.name
    assert len(third.stages) == len(third.subinstructions)
    assert third.next_after(0) == third.subinstructions[0]
    other = source.load("4").poses()
    assert other.shape == third.poses().shape
    assert np.abs(other[..., :3] - third.poses()[..., :3]).max() > 0.01


def test_a_page_looks_from_a_camera_that_stands_still(opened, data):
    side = Camera(name="side", position=(0.5, 1.2, 0.5), look_at=(0.5, 0.0, 0.1), fovy_deg=40.0)
    seen = {"eye": [0.5, 1.2, 0.5], "target": [0.5, 0.0, 0.1], "fovy": 40.0}
    for what, item in (("bin_sort", "0"), (str(data), f"{TASK}/00000")):
        trajectory = opened(what, view=view_from(side)).load(item)
        assert read_scene(trajectory.scene_data).header["camera"] == seen
    head = view_from("head")
    assert head.eye == HEAD_POSITION
    assert head.target[2] == pytest.approx(0.0, abs=1e-12)
    assert head.fovy_deg == pytest.approx(51.9, abs=0.05)
    with pytest.raises(UnknownNameError, match="stands still"):
        view_from("left_wrist")
    with pytest.raises(OptionError, match="'side' moves with an arm"):
        view_from(replace(side, on="left_flange"))


def test_a_take_of_real_arms_is_shown_as_they_were_measured(tmp_path, opened):
    env, _ = real_recorder(tmp_path / "real", horizon=5)
    play_real(env, 5)
    env.close()
    source = opened(str(tmp_path / "real"))
    (item,) = source.items
    trajectory = source.load(item.id)
    (recording,) = DataSet.open(tmp_path / "real").recordings()
    simulation = Simulation(catalog.get(TASK).props)
    joints = np.delete(recording.agent_pos[-1], OPENING_SLOTS).reshape(2, -1)
    simulation.duo.set_configuration(DuoCommand(joints=joints, openings=np.ones(2)))
    simulation.forward()
    arms = Geometry(simulation.model).poses(simulation.data)
    shown = trajectory.poses()[-1]
    near = np.abs(shown[:, :3] - arms[:, :3]).max(axis=1) < MILLIMETRE
    assert len(trajectory.poses()) == 6
    assert near.all()
    assert "the cameras show" in trajectory.note
    seen = source.images(item.id, 5)
    assert sorted(seen) == sorted(POLICY_CAMERAS)
    assert all(image.startswith(b"\xff\xd8\xff") for image in seen.values())


def test_a_take_that_is_cut_and_not_to_be_used_says_so(tmp_path, opened):
    env = recorder(tmp_path / "cut", split="train")
    play(env, steps=5)
    env.finish(kept=False, reason="Broken off.")
    env.close()
    source = opened(str(tmp_path / "cut"))
    (item,) = source.items
    assert item.detail == "wave: cut, stage 0 of 5, not to be used"
    assert (item.state, item.take.reason) == ("not to be used", "Broken off.")
    other = DataSet.open(tmp_path / "cut")
    other.reviews.add(other.episodes()[0], kept=True)  # as another program does
    source.refresh()
    (item,) = source.items
    assert (item.state, item.take.reason) == ("cut", "")


def test_a_file_that_cannot_be_read_keeps_no_other_take_away(data, tmp_path, opened):
    shutil.copytree(data, tmp_path / "half")
    folder = DataSet.open(tmp_path / "half")
    (path,) = folder.episodes()
    whole = path.read_bytes()
    other = path.with_stem("00001")
    other.write_bytes(whole[: len(whole) // 2])  # it is being copied
    source = opened(str(folder.path))
    assert [item.id for item in source.items] == [f"{TASK}/00000"]
    assert source.title == "half, without 1 that cannot be read"
    other.write_bytes(whole)
    source.refresh()
    assert (len(source.items), source.title) == (2, "half")
    source.review(f"{TASK}/00000", kept=False)
    path.unlink()
    with pytest.raises(DataError, match="Cannot read"):
        source.review(f"{TASK}/00000", kept=True)
    source.refresh()
    for gone in (source.load, source.review, lambda item: source.images(item, 0)):
        with pytest.raises(DataError, match=f"{TASK}/00000 is no longer there"):
            gone(f"{TASK}/00000")
    other.write_bytes(b"")
    with pytest.raises(DataError, match="Cannot read"):
        opened(str(folder.path))


def test_a_recorded_episode_is_shown_as_its_states_were(data, opened):
    source = opened(str(data))
    assert isinstance(source, DataSource)
    (item,) = source.items
    assert (item.id, item.title, item.state) == (f"{TASK}/00000", f"{TASK} 00000", "failure")
    trajectory = source.load(item.id)
    (path,) = DataSet.open(data).episodes()
    recording = Recording.read(path)
    poses = trajectory.poses()
    assert len(poses) == HORIZON + 1
    assert trajectory.instruction == recording.info.instruction
    with closing(SimEnv(catalog.get(TASK))) as env:
        env.reset(options={"layout": recording.info.layout})
        geometry = Geometry(env.simulation.model)
        env.simulation.set_state(recording.state[HORIZON])
        expected = geometry.poses(env.simulation.data)
    np.testing.assert_allclose(poses[HORIZON, :, :3], expected[:, :3], atol=MILLIMETRE)
    assert np.abs(poses[HORIZON] - poses[0]).max() > 0.01


def test_episodes_of_a_run_are_played_from_their_targets(play, tmp_path, opened):
    folder, results = play("random", episodes=2)
    write_bundle(folder, tmp_path / "run.zip")
    for path in (folder.path, tmp_path / "run.zip"):
        source = opened(str(path), import_tasks=True)
        assert isinstance(source, RunSource)
        assert [item.id for item in source.items] == ["wave/0", "wave/1", "nod/0", "nod/1"]
        records = [each for task in results.tasks for each in task.records]
        for item, record in zip(source.items, records, strict=True):
            trajectory = source.load(item.id)
            assert trajectory.stage_changes == record.stage_changes
            assert len(trajectory.poses()) == record.steps + 1
            assert trajectory.stage_after(record.steps) == record.final_stage
            assert trajectory.note == record.missing
            assert item.detail == f"{item.state}, stage {record.final_stage} of {record.max_stage}"


def test_episodes_of_some_tasks_alone(data, play):
    folder, _ = play("random", episodes=1)
    items = open_view(str(folder.path), tasks=["nod"]).items
    assert [item.id for item in items] == ["nod/0"]
    assert [item.id for item in open_view(str(data), tasks=[TASK]).items] == [f"{TASK}/00000"]
    for path in (folder.path, data):
        with pytest.raises(UnknownNameError, match="Unknown task in the"):
            open_view(str(path), tasks=["carry_pot"])


def test_code_of_others_is_not_run_unasked(play, opened):
    folder, _ = play("random", episodes=1)
    with pytest.raises(UnknownNameError, match="not in the benchmark"):
        opened(str(folder.path)).load("wave/0")


def test_an_episode_that_failed_with_an_error_says_with_which(play, opened):
    folder, results = play("Faulty", episodes=1)
    source = opened(str(folder.path), import_tasks=True)
    failed = {item.id for item in source.items if item.state == "error"}
    records = [each for task in results.tasks for each in task.records if each.error]
    assert failed == {f"{each.task}/{each.episode}" for each in records} != set()
    for record in records:
        assert source.load(f"{record.task}/{record.episode}").note == record.reason


@pytest.mark.parametrize(
    ("make", "kind", "message"),
    [
        (lambda _path: None, UnknownNameError, "Unknown task"),
        (lambda path: (path / "other").mkdir(parents=True), EvaluationError, "neither a data set"),
        (DataSet.open, EvaluationError, "no finished episode"),
    ],
)
def test_what_cannot_be_viewed(tmp_path, monkeypatch, make, kind, message):
    monkeypatch.chdir(tmp_path)
    make(tmp_path / "x")
    with pytest.raises(kind, match=message):
        open_view("x")


def test_a_task_of_ones_own(opened):
    assert opened(toy_tasks.WAVE_NAME).load("0").task == "wave"


# --- a run that others write ---------------------------------------------------------------------


@pytest.fixture
def server() -> Iterator[PageServer]:
    server = PageServer({})
    yield server
    server.close()


def followed(folder: RunFolder, server: PageServer) -> FollowedRun:
    return FollowedRun(folder, server, import_tasks=True)


@pytest.mark.slow
def test_a_run_is_followed_from_before_its_start(play, server):
    path = play("random", "other", episodes=1)[0].path.with_name("run")
    run = followed(RunFolder(path), server)
    assert run.refresh() == {"run": {"note": "Nothing is written yet."}}
    folder, results = play("random", episodes=2)
    folder.page.unlink()
    folder.discard(results.tasks[1].records[1].key)
    found = run.refresh()["run"]
    assert (found["finished"], found["of"]) == (3, 4)
    rows = [(row["task"], row["episodes"], row["of"]) for row in found["rows"]]
    assert rows == [("wave", 2, 2), ("nod", 1, 2)]
    for row in found["rows"]:
        assert row["wilson_95"] == list(wilson_interval(row["successes"], row["episodes"]))
    failed = {item.id for item in run.items if item.state != "success"}
    assert {each["id"] for each in found["failures"]} == failed
    assert [item.id for item in run.items] == ["wave/0", "wave/1", "nod/0"]
    assert len(run.load("nod/0").poses()) == results.tasks[1].records[0].steps + 1
    run.close()


def test_every_record_is_read_once(play, server, monkeypatch):
    folder, _ = play("random", episodes=2)
    read: list[Any] = []
    whole = RunReader.read_record
    monkeypatch.setattr(
        RunReader, "read_record", lambda *words: read.append(words[-1]) or whole(*words)
    )
    run = followed(folder, server)
    for _ in range(3):
        run.refresh()
    assert len(read) == len(set(read)) == 4


def test_the_report_is_shown_once_it_is_that_of_all_episodes(play, server):
    folder, _ = play("random", episodes=1)
    run = followed(folder, server)
    shown = run.refresh()
    assert get(server.url, shown["report"])[2] == folder.page.read_bytes()
    content = folder.page.read_bytes()
    folder.page.unlink()
    assert "report" not in run.refresh()
    assert run.refresh(is_last=True)["ended"]
    folder.page.write_bytes(content)
    play("random", episodes=2)
    (folder.path / "records/nod").rename(folder.path / "elsewhere")
    assert "report" not in run.refresh()
    assert run.refresh(is_last=True)["report"] == shown["report"]


def test_a_run_that_cannot_be_read_says_so_and_is_followed_on(play, server):
    folder, results = play("random", episodes=1)
    path = folder.record(results.tasks[0].records[0].key)
    content = path.read_bytes()
    path.write_bytes(b"{")
    run = followed(folder, server)
    assert "cannot be read now" in run.refresh()["run"]["note"]
    path.write_bytes(content)
    assert run.refresh()["run"]["finished"] == 2


def test_a_viewer_shows_what_comes(play, server, tmp_path):
    run = followed(RunFolder(tmp_path / "run"), server)
    viewer = Viewer(run, server, run.refresh)
    viewer.stop()
    play("random", episodes=1)
    viewer.run()
    assert server._latest["status"]
    assert '"report"' in str(server._latest["status"])


def test_a_break_of_a_run_is_no_time_that_it_took(play, server):
    folder, results = play("random", episodes=2)
    keys = [record.key for task in results.tasks for record in task.records]
    folder.discard(keys.pop())
    end = time.time()
    days = 3 * 86400.0
    moments = [end - days - 20.0, end - days - 10.0, end - days, end]  # gone on with days later
    for path, moment in zip([folder.description, *map(folder.record, keys)], moments, strict=True):
        os.utime(path, (moment, moment))
    found = followed(folder, server).refresh()["run"]
    assert found["elapsed_s"] == pytest.approx(20.0, abs=5.0)
    assert found["left_s"] == pytest.approx(10.0, abs=0.1)
