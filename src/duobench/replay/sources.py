"""What can be viewed: a task, recorded episodes, and the episodes of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from duobench.data import DataSet, ImageSource, Recording
from duobench.data.dataset import DESCRIPTION as DATA_SET
from duobench.envs.config import LAYOUT_SEED
from duobench.envs.sim_env import SimEnv
from duobench.errors import EvaluationError, check_known
from duobench.looks.catalog import DEFAULT, as_look
from duobench.looks.look import Look
from duobench.replay.player import Latest, RecordPlayer, why_not
from duobench.replay.trajectory import SceneCache, Trajectory, TrajectoryRecorder
from duobench.replay.verify import disagreements
from duobench.results.bundle import open_source
from duobench.results.folder import DESCRIPTION as RUN
from duobench.results.folder import RunReader
from duobench.results.records import EpisodeRecord
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.web import track

LAYOUTS = 20
"""Layouts of a task that can be chosen."""
SUCCESS, FAILURE, ERROR = "success", "failure", "error"
"""How an episode ended, as the page shows it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Item:
    """Something that can be chosen."""

    id: str
    title: str
    """What people read."""
    detail: str = ""
    state: str = ""
    """How it ended; empty where nothing did."""


class ViewSource(Protocol):
    """Episodes to view."""

    @property
    def title(self) -> str:
        """What all of it is."""
        ...

    @property
    def items(self) -> Sequence[Item]:
        """What can be chosen, in its order."""
        ...

    def load(self, item: str) -> Trajectory:
        """Make what is shown of an item; always called in the same thread, and it may take long."""
        ...

    def close(self) -> None:
        """Free what it holds; called in the thread of `load`."""
        ...


class TaskSource:
    """A task as its resets leave it: an environment at rest, which is reset whenever one chooses.

    Its layouts are those of `duobench render --seed`.
    """

    def __init__(self, task: str | Task, look: str | Look = DEFAULT) -> None:
        self._task, self._look = catalog.get(task), as_look(look)
        self._env: Latest[SimEnv] = Latest()
        self._scenes = SceneCache()
        self.title = self._task.title
        self.items = [Item(id=str(seed), title=f"Layout {seed}") for seed in range(LAYOUTS)]
        """The first layouts."""

    def load(self, item: str) -> Trajectory:
        """Reset the environment."""
        env = self._env.get(self._task.id, lambda: SimEnv(self._task, look=self._look))
        _, info = env.reset(options={LAYOUT_SEED: int(item)})
        recorder = TrajectoryRecorder(self._scenes, self._look)
        recorder.on_episode_start(env, {}, info)
        return recorder.trajectory()

    def close(self) -> None:
        """Close the environment."""
        self._env.close()


class DataSource:
    """The episodes of a data set, as their recorded states are."""

    def __init__(
        self, data: DataSet, look: str | Look = DEFAULT, tasks: Sequence[str] = ()
    ) -> None:
        self._look = as_look(look)
        self.title = data.path.name
        """Name of the folder."""
        self._paths = {f"{path.parent.name}/{path.stem}": path for path in data.episodes_of(tasks)}
        self.items = [_recorded(name, path) for name, path in self._paths.items()]
        """All episodes."""
        self._source: Latest[ImageSource] = Latest()
        self._scenes = SceneCache()

    def load(self, item: str) -> Trajectory:
        """Collect the poses of every recorded state."""
        recording = Recording.read(self._paths[item])
        info = recording.info
        task = catalog.get(info.task)
        if info.is_real:
            raise EvaluationError(
                "It was played on real arms, whose objects nobody measured: there is no state of a "
                "simulation to show."
            )
        source = self._source.get(info.task, lambda: ImageSource(task, cameras=(), look=self._look))
        source.show(recording, 0)  # with the variants of its layout
        geometry = self._scenes.of(source.simulation, self._look)
        poses = []
        for row in range(len(recording) + 1):
            source.show(recording, row)
            poses.append(geometry.poses(source.simulation.data))
        rises = np.flatnonzero(np.diff(recording.stage, prepend=0) > 0).tolist()
        return Trajectory(
            task=info.task,
            instruction=info.instruction,
            stages=tuple(stage.name for stage in task.stages),
            subinstructions=info.subinstructions,
            stage_changes=tuple((row, int(recording.stage[row])) for row in rises),
            scene=geometry.name,
            scene_data=geometry.data,
            track=track.encode(np.array(poses)),
        )

    def close(self) -> None:
        """Close the simulation."""
        self._source.close()


class RunSource:
    """The finished episodes of a run, played again from the joint targets in their records.

    Args:
        run: The run.
        look: How it looks.
        tasks: Only the episodes of these tasks; of all if none is named.
        import_tasks: Whether to import tasks that are not of the benchmark, which runs the code of
            the modules that the run names.
    """

    def __init__(
        self,
        run: RunReader,
        look: str | Look = DEFAULT,
        tasks: Sequence[str] = (),
        *,
        import_tasks: bool = False,
    ) -> None:
        self._look, self._reader = as_look(look), run
        self.run = run.read_run()
        titles = ", ".join(candidate.title for candidate in self.run.candidates)
        self.title = f"{run.path.name}: {titles}"
        """Name of the folder, and the policy."""
        known = {task.id for task in self.run.suite.tasks}
        self._wanted = {catalog.plain(task) for task in tasks} or known
        for task in self._wanted:
            check_known("task in the run", task, known)
        self.records: dict[str, EpisodeRecord] = {}
        """Of all finished episodes, by the ids of their items."""
        self.items: list[Item] = []
        self._player = RecordPlayer(self.run, import_tasks=import_tasks)
        self._scenes = SceneCache()
        self.refresh()

    def refresh(self) -> None:
        """List what is finished now; only records that were not there before are read."""
        before, several = self.records, len(self.run.conditions) > 1
        self.records = {}
        for key in self._reader.finished(self.run):
            if key.task in self._wanted:
                name = f"{key.task}/{f'{key.condition}/' if several else ''}{key.episode}"
                record = before.get(name) or self._reader.read_record(self.run, key)
                self.records[name] = record
        self.items = [_finished(name, record) for name, record in self.records.items()]

    def load(self, item: str) -> Trajectory:
        """Play the targets of a record, and collect the poses."""
        record = self.records[item]
        if reason := why_not(record):
            raise EvaluationError(f"{reason} {record.reason}".rstrip())
        recorder = TrajectoryRecorder(self._scenes, self._look)
        replay = self._player.replay(record, [recorder])
        notes = [record.reason] if record.error else [record.missing] if record.missing else []
        if found := disagreements(record, replay):
            notes.append(f"Played again here it comes out differently: {'; '.join(found)}.")
        return recorder.trajectory(" ".join(notes))

    def close(self) -> None:
        """Close the environment."""
        self._player.close()


def open_view(
    what: str,
    look: str | Look = DEFAULT,
    tasks: Sequence[str] = (),
    *,
    import_tasks: bool = False,
) -> ViewSource:
    """What a word names: a data set or a run by its folder, a bundle of a run, or a task.

    Args:
        what: Folder or file, id of a task, or its import path.
        look: How it looks.
        tasks: Only the episodes of these tasks; of all if none is named.
        import_tasks: See `RunSource`.

    Raises:
        DuoBenchError: There is no such thing, nothing in it can be viewed, or it cannot be read.
    """
    path = Path(what)
    if (path / DATA_SET).exists():
        source = DataSource(DataSet.open(path, create=False), look, tasks)
    elif path.is_file() or (path / RUN).exists():
        source = RunSource(open_source(path), look, tasks, import_tasks=import_tasks)
    elif path.exists() and catalog.plain(what) not in catalog.names():
        raise EvaluationError(
            f"{what} holds neither a data set ({DATA_SET}) nor an evaluation ({RUN})."
        )
    else:
        return TaskSource(what, look)
    if not source.items:
        raise EvaluationError(f"{what} has no finished episode to view.")
    return source


def _recorded(name: str, path: Path) -> Item:
    info = Recording.read_info(path)
    outcome = info.outcome
    succeeded = outcome is not None and outcome.success
    actor = info.actor.name or str(info.actor.kind)
    stage = "" if outcome is None else f", stage {outcome.stage} of {outcome.max_stage}"
    state = SUCCESS if succeeded else FAILURE
    detail = f"{actor}: {state}{stage}"
    return Item(id=name, title=name.replace("/", " "), detail=detail, state=state)


def _finished(name: str, record: EpisodeRecord) -> Item:
    state = ERROR if record.error else SUCCESS if record.success else FAILURE
    detail = f"{state}, stage {record.final_stage} of {record.max_stage}"
    return Item(id=name, title=f"{record.task} {record.episode}", detail=detail, state=state)
