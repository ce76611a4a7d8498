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
from duobench.replay.claims import disagreements
from duobench.replay.playback import Playback, PoseCollector, SceneCache, StageChanges
from duobench.replay.player import TargetPlayer, actual_task, obstacle
from duobench.results.reader import DESCRIPTION as RUN
from duobench.results.reader import RunReader
from duobench.results.records import EpisodeRecord
from duobench.results.source import open_source
from duobench.results.suite import TaskInfo
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
    """What it is known by."""
    title: str
    """What people read."""
    detail: str = ""
    """What else they read."""
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

    def load(self, item: str) -> Playback:
        """Make what is shown of an item; always called in the same thread, and it may take long.

        Raises:
            DuoBenchError: It cannot be shown.
        """
        ...

    def close(self) -> None:
        """Free what it holds; called in the thread of `load`."""
        ...


class TaskSource:
    """A task as its resets leave it: an environment at rest, which is reset whenever one chooses.

    Its layouts are those of `duobench render --seed`.
    """

    def __init__(self, task: str | Task, look: str | Look = DEFAULT) -> None:
        """Find the task.

        Raises:
            UnknownNameError: There is no such task or look.
        """
        self._task, self._look = catalog.get(task), as_look(look)
        self._env: SimEnv | None = None
        self._scenes = SceneCache()

    @property
    def title(self) -> str:
        """The task's name."""
        return self._task.title

    @property
    def items(self) -> Sequence[Item]:
        """The first layouts."""
        return [Item(id=str(seed), title=f"Layout {seed}") for seed in range(LAYOUTS)]

    def load(self, item: str) -> Playback:
        """Reset the environment."""
        self._env = self._env or SimEnv(self._task, look=self._look)
        _, info = self._env.reset(options={LAYOUT_SEED: int(item)})
        collector = PoseCollector(self._scenes, self._look)
        collector.on_episode_start(self._env, {}, info)
        return _playback(collector, self._task, info["instruction"], ())

    def close(self) -> None:
        """Close the environment."""
        if self._env is not None:
            self._env.close()


class DataSource:
    """The episodes of a data set, as their recorded states are."""

    def __init__(
        self, data: DataSet, look: str | Look = DEFAULT, tasks: Sequence[str] = ()
    ) -> None:
        """List the episodes of some tasks, or of all if none is named.

        Raises:
            UnknownNameError: There is no such look, or no episode of a task.
            DataError: An episode cannot be read.
        """
        self._look = as_look(look)
        self.title = data.path.name
        """Name of the folder."""
        self._paths = {f"{path.parent.name}/{path.stem}": path for path in data.episodes_of(tasks)}
        self.items = [_recorded(name, path) for name, path in self._paths.items()]
        """All episodes."""
        self._source: ImageSource | None = None
        self._task = ""
        self._scenes = SceneCache()

    def load(self, item: str) -> Playback:
        """Collect the poses of every recorded state."""
        recording = Recording.read(self._paths[item])
        info = recording.info
        task = catalog.get(info.task)
        if info.is_real:
            raise EvaluationError(
                "It was played on real arms, whose objects nobody measured: there is no state of a "
                "simulation to show."
            )
        if self._source is None or self._task != info.task:
            self.close()
            self._source, self._task = ImageSource(task, cameras=(), look=self._look), info.task
        simulation, poses = self._source.simulation, []
        self._source.show(recording, 0)  # with the variants of its layout
        geometry = self._scenes.of(simulation, self._look)
        for row in range(len(recording) + 1):
            self._source.show(recording, row)
            poses.append(geometry.poses(simulation.data))
        rises = np.flatnonzero(np.diff(recording.stage, prepend=0) > 0).tolist()
        return Playback(
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
        if self._source is not None:
            self._source.close()


class RunSource:
    """The finished episodes of a run, played again from the joint targets in their records."""

    def __init__(
        self,
        run: RunReader,
        look: str | Look = DEFAULT,
        tasks: Sequence[str] = (),
        *,
        import_tasks: bool = False,
    ) -> None:
        """List the episodes of some tasks, or of all if none is named.

        Args:
            run: The run.
            look: How it looks.
            tasks: The tasks.
            import_tasks: Whether to import tasks that are not of the benchmark, which runs the code
                of the modules that the run names.

        Raises:
            UnknownNameError: There is no such look, or the run has no such task.
            EvaluationError: There is no run, or a record is of another one.
            FileError: A file of it cannot be read.
        """
        self._look, self._import_tasks = as_look(look), import_tasks
        self._run = run.read_run()
        self.title = f"{run.path.name}: {self._run.title}"
        """Name of the folder, and the policy."""
        self._tasks = {task.id: task for task in self._run.suite.tasks}
        wanted = {catalog.plain(task) for task in tasks} or self._tasks.keys()
        for task in wanted:
            check_known("task in the run", task, self._tasks)
        self._records = {
            f"{record.task}/{record.episode}": record
            for record in run.read_records(self._run)
            if record.task in wanted
        }
        self.items = [_finished(name, record) for name, record in self._records.items()]
        """All finished episodes."""
        self._player: TargetPlayer | None = None
        self._task: TaskInfo | None = None
        self._scenes = SceneCache()

    def load(self, item: str) -> Playback:
        """Play the targets of a record, and collect the poses."""
        record = self._records[item]
        if reason := obstacle(record):
            raise EvaluationError(f"{reason} {record.reason}".rstrip())
        task = actual_task(self._tasks[record.task], import_tasks=self._import_tasks)
        if self._player is None or self._task != task:
            self.close()
            self._player, self._task = TargetPlayer(task), task
        collector = PoseCollector(self._scenes, self._look)
        replay = self._player.play(self._run, record, [collector])
        notes = [record.reason] if record.error else [record.missing] if record.missing else []
        if found := disagreements(record, replay):
            notes.append(f"Played again here it comes out differently: {'; '.join(found)}.")
        return _playback(
            collector,
            catalog.get(task.reference),
            record.instruction,
            replay.stage_changes,
            " ".join(notes),
        )

    def close(self) -> None:
        """Close the environment."""
        if self._player is not None:
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
        UnknownNameError: It is no such file, and no task either.
        EvaluationError: Nothing in it can be viewed.
        DuoBenchError: It cannot be read.
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


def _playback(
    collector: PoseCollector,
    task: Task,
    instruction: str,
    stage_changes: StageChanges,
    note: str = "",
) -> Playback:
    if collector.geometry is None:
        raise AssertionError("An episode begins before it is shown.")
    return Playback(
        task=task.id,
        instruction=instruction,
        stages=tuple(stage.name for stage in task.stages),
        subinstructions=collector.subinstructions,
        stage_changes=stage_changes,
        scene=collector.geometry.name,
        scene_data=collector.geometry.data,
        track=collector.track(),
        note=note,
    )


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
