"""What can be viewed: tasks, data sets and runs, down to where every body is."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from duobench.data import DataSet, Recording
from duobench.envs.config import LAYOUT_SEED
from duobench.envs.sim_env import SimEnv
from duobench.errors import EvaluationError, UnknownNameError
from duobench.replay.sources import (
    DataSource,
    RunSource,
    TaskSource,
    ViewSource,
    open_view,
)
from duobench.results.bundle import write_bundle
from duobench.results.folder import RunFolder
from duobench.tasks import catalog
from duobench.web.geometry import Geometry
from tests.data.tools import HORIZON, TASK, recorded
from tests.evaluation import toy_tasks

MILLIMETRE = 1e-3


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "waved"
    recorded(folder)
    return folder


@pytest.fixture
def opened() -> Iterator[list[ViewSource]]:
    sources: list[ViewSource] = []
    yield sources
    for source in sources:
        source.close()


def test_a_task_is_shown_as_its_reset_leaves_it(opened):
    source = open_view("bin_sort")
    opened.append(source)
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


def test_a_recorded_episode_is_shown_as_its_states_were(data, opened):
    source = open_view(str(data))
    opened.append(source)
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
        source = open_view(str(path), import_tasks=True)
        opened.append(source)
        assert isinstance(source, RunSource)
        assert [item.id for item in source.items] == ["wave/0", "wave/1", "nod/0", "nod/1"]
        for item, record in zip(
            source.items, [each for task in results.tasks for each in task.records], strict=True
        ):
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
    source = open_view(str(folder.path))
    opened.append(source)
    with pytest.raises(UnknownNameError, match="none of the benchmark"):
        source.load("wave/0")


def test_an_episode_that_failed_with_an_error_says_with_which(play, opened):
    folder, _ = play("Faulty", episodes=1)
    source = RunSource(RunFolder(folder.path), import_tasks=True)
    opened.append(source)
    records = {
        f"{each.task}/{each.episode}": each
        for each in RunFolder(folder.path).read_records(RunFolder(folder.path).read_run())
    }
    failed = [item.id for item in source.items if item.state == "error"]
    assert failed
    for name in failed:
        assert source.load(name).note == records[name].reason


@pytest.mark.parametrize(
    ("files", "kind", "message"),
    [
        ([], UnknownNameError, "Unknown task"),
        (["x/other"], EvaluationError, "holds neither a data set"),
    ],
)
def test_what_cannot_be_viewed(tmp_path, monkeypatch, files, kind, message):
    monkeypatch.chdir(tmp_path)
    for file in files:
        (tmp_path / file).parent.mkdir()
        (tmp_path / file).touch()
    with pytest.raises(kind, match=message):
        open_view("x")


def test_a_data_set_without_episodes(tmp_path):
    DataSet.open(tmp_path / "empty")
    with pytest.raises(EvaluationError, match="no finished episode"):
        open_view(str(tmp_path / "empty"))


def test_a_task_of_ones_own(opened):
    source = open_view(toy_tasks.WAVE_NAME)
    opened.append(source)
    assert source.load("0").task == "wave"
