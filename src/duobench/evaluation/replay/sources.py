"""Sources of the viewer: a task, recorded episodes, and episodes of a run, finished or not."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from duobench.core.errors import DataError, DuoBenchError, EvaluationError, check_known
from duobench.core.types import (
    CONTROL_HZ,
    OPENING_SLOTS,
    SIDES,
    DuoCommand,
)
from duobench.core.video import jpeg
from duobench.data import (
    DataSet,
    EpisodeInfo,
    ImageSource,
    Recording,
)
from duobench.data.dataset import DESCRIPTION as DATA_SET
from duobench.data.images import RecordedImages, resized
from duobench.data.reviews import name_of
from duobench.envs.config import LAYOUT_SEED
from duobench.envs.sim_env import SimEnv
from duobench.evaluation.replay.player import Latest, RecordPlayer, why_not
from duobench.evaluation.replay.takes import UNUSED, Recorded, Take
from duobench.evaluation.replay.trajectory import (
    SceneCache,
    Trajectory,
    TrajectoryRecorder,
)
from duobench.evaluation.replay.verification import disagreements
from duobench.results.attempts import ERROR, FAILURE
from duobench.results.bundle import open_source
from duobench.results.folder import DESCRIPTION as RUN, RunFolder, RunReader
from duobench.results.journal import end_of
from duobench.results.records import Record
from duobench.results.scores import group_by_condition
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.web.server import PageServer
from duobench.world.looks.catalog import DEFAULT, as_look
from duobench.world.looks.look import Look
from duobench.world.robot.cameras import View
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER
from duobench.world.sim.simulation import Simulation

LAYOUTS = 20
IMAGE_SIZE = (270, 480)
"""Height and width of what cameras of a rig saw, in pixels."""
REAL_ARMS = (
    "Real arms as they were measured, with open grippers; objects stand where the layout asked for "
    "them. What really was there the cameras show."
)
FAILURES = 5
"""Failures that are listed, the latest first."""
_LATEST = 20
"""Finished episodes from whose times the remaining time is estimated."""
_BREAK_S = 3600.0
"""Seconds without a finished episode that are a break of the run, which counts nowhere."""
_LEAVING_S, _LOADING_S, _LOOK_S = 10.0, 2.0, 0.1
"""Seconds that visitors have to open the report and then to load it, and between two looks."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Item:
    """Item that can be chosen."""

    id: str
    title: str
    detail: str = ""
    state: str = ""
    """End of the episode in words; empty for other items."""
    take: Take | None = None
    """What a second look shows of a recording."""


class TaskSource:
    """A task as its resets leave it: an environment at rest, which is reset whenever one chooses.

    Its layouts are those of `duobench render --seed`.
    """

    def __init__(
        self,
        task: str | Task,
        look: str | Look = DEFAULT,
        view: View | None = None,
        gripper: str = DEFAULT_GRIPPER,
    ) -> None:
        self._task, self._look = catalog.get(task), as_look(look)
        self._robot = robot_with(gripper)
        self._env: Latest[SimEnv] = Latest()
        self._scenes = SceneCache(view)
        self.title = self._task.title
        self.items = [
            Item(id=str(seed), title=f"Layout {seed}") for seed in range(LAYOUTS)
        ]

    def load(self, item: str) -> Trajectory:
        """Reset the environment."""
        env = self._env.get(
            self._task.id,
            lambda: SimEnv(self._task, look=self._look, robot=self._robot),
        )
        _, info = env.reset(options={LAYOUT_SEED: int(item)})
        recorder = TrajectoryRecorder(self._scenes, self._look)
        recorder.on_episode_start(env, {}, info)
        return recorder.trajectory()

    def close(self) -> None:
        """Close the environment."""
        self._env.close()


class DataSource:
    """The episodes of a data set, as their recorded states are, for a second look at them."""

    def __init__(
        self,
        data: DataSet,
        look: str | Look = DEFAULT,
        tasks: Sequence[str] = (),
        view: View | None = None,
    ) -> None:
        self._data, self._look, self._tasks = data, as_look(look), tasks
        self._source: Latest[ImageSource] = Latest()
        self._films: Latest[RecordedImages] = Latest()
        self._scenes = SceneCache(view)
        self._reviews = data.reviews
        self._recorded: dict[str, Recorded] = {}
        unreadable = self._list()
        if unreadable and not self._items:
            raise unreadable[0]

    @property
    def items(self) -> list[Item]:
        """The takes, as they stand now."""
        return list(self._items.values())

    def refresh(self, is_last: bool = False) -> dict[str, Any]:  # noqa: ARG002 - as of a run
        """List new recordings, and what others have said about those that are there."""
        if self._reviews.refresh() or len(self._files()) != len(self._recorded):
            self._list()
        return {}

    def review(self, item: str, **said: Any) -> None:
        """Write down what somebody says about a take, unless that is so; see `Reviews.add`."""
        path = self._find(item).path
        if not self._reviews.of(path).says(**said):
            self._reviews.add(path, **said)
            self._list()

    def _files(self) -> list[Path]:
        """Files of the recordings that are viewed."""
        return self._data.episodes_of(self._tasks)

    def _find(self, item: str) -> Recorded:
        if item not in self._recorded:
            raise DataError(f"{item} is no longer there, or cannot be read.")
        return self._recorded[item]

    def _list(self) -> list[DataError]:
        """List the takes; return why files cannot be read, or not yet, which are left out."""
        before = self._recorded
        self._recorded, self._items = {}, {}
        unreadable: list[DataError] = []
        for path in self._files():
            name = name_of(path)
            try:
                recorded = before.get(name) or Recorded.read(path)
                self._items[name] = _recorded(name, recorded.take(self._reviews))
            except DataError as error:
                unreadable.append(error)
            else:
                self._recorded[name] = recorded
        self.title = self._data.path.name
        if unreadable:
            self.title += f", without {len(unreadable)} that cannot be read"
        return unreadable

    def load(self, item: str) -> Trajectory:
        """Collect the poses of every recorded state."""
        recording = Recording.read(self._find(item).path)
        info = recording.info
        task = catalog.get(self._data.reference(info))
        source = self._source.get(
            info.task, lambda: ImageSource(task, cameras=(), look=self._look)
        )
        source.take(info.robot)
        show = source.show
        note = ""
        if info.is_real:
            show = _picture_of(source.simulation, task, info)
            note = REAL_ARMS
        show(recording, 0)  # with the variants of its layout
        recorder = TrajectoryRecorder(self._scenes, self._look)
        recorder.begin(source.simulation, task, info.instruction, info.subinstructions)
        for row in range(len(recording) + 1):
            show(recording, row)
            recorder.add(row, int(recording.stage[row]))
        corrections = recording.corrections
        if corrections:
            note = f"{note} {_in_words(corrections)}".strip()
        return replace(recorder.trajectory(note), corrections=corrections)

    def images(
        self,
        item: str,
        row: int,
    ) -> dict[str, bytes]:
        """Images of a rig's cameras at a row, as JPEG by camera; none for simulated recordings.

        Raises:
            DataError: A video cannot be read.
        """
        recorded = self._find(item)
        path = recorded.path
        cameras = list(recorded.info.videos)
        if not cameras:
            return {}
        films = self._films.get(
            path,
            lambda: RecordedImages(
                Recording.read(path), path, cameras, IMAGE_SIZE, lambda *_: resized
            ),
        )
        return {name: jpeg(image) for name, image in films.images(row).items()}

    def close(self) -> None:
        """Close the simulation and the videos."""
        self._source.close()
        self._films.close()


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
        view: View | None = None,
    ) -> None:
        self._look, self._reader = as_look(look), run
        self.run = run.read_run()
        titles = ", ".join(candidate.title for candidate in self.run.candidates)
        self.title = f"{run.path.name}: {titles}"
        known = {task.id for task in self.run.suite.tasks}
        self._wanted = {catalog.id_of(task) for task in tasks} or known
        for task in self._wanted:
            check_known("task in the run", task, known)
        self.records: dict[str, Record] = {}
        """Records of all finished episodes, by the ids of their items."""
        self.items: list[Item] = []
        self._player = RecordPlayer(self.run, import_tasks=import_tasks)
        self._scenes = SceneCache(view)
        self.refresh()

    def refresh(self) -> None:
        """List what is finished now; only records that were not there before are read."""
        before, several = self.records, len(self.run.conditions) > 1
        self.records = {}
        for key in self._reader.finished(self.run):
            if key.task in self._wanted:
                name = (
                    f"{key.task}/{f'{key.condition}/' if several else ''}{key.episode}"
                )
                record = before.get(name) or self._reader.read_record(self.run, key)
                self.records[name] = record
        self.items = [_finished(name, record) for name, record in self.records.items()]

    def load(self, item: str) -> Trajectory:
        """Play the targets of a record, and collect the poses."""
        record = self.records[item]
        reason = why_not(record)
        if reason:
            raise EvaluationError(f"{reason} {record.reason}".rstrip())
        recorder = TrajectoryRecorder(self._scenes, self._look)
        replay = self._player.replay(record, [recorder])
        notes = (
            [record.reason]
            if record.error
            else [record.missing]
            if record.missing
            else []
        )
        found = disagreements(record, replay)
        if found:
            notes.append(
                f"Played again here it comes out differently: {'; '.join(found)}."
            )
        return recorder.trajectory(" ".join(notes))

    def close(self) -> None:
        """Close the environment."""
        self._player.close()


class FollowedRun:
    """A run as a source of a viewer, whose episodes come as they are finished.

    It reads the records that are there, each once, and knows nothing of what plays. There may be
    none yet, nor a run.

    Args:
        folder: The folder of the run.
        server: The page, which gives the report out.
        look: How it looks.
        tasks: Only the episodes of these tasks; of all if none is named.
        import_tasks: See `RunSource`.
    """

    def __init__(
        self,
        folder: RunFolder,
        server: PageServer,
        look: str | Look = DEFAULT,
        tasks: Sequence[str] = (),
        *,
        import_tasks: bool = False,
        view: View | None = None,
    ) -> None:
        self.title = folder.path.name
        self._folder, self._server = folder, server
        self._look = as_look(look)
        self._tasks = tasks
        self._import_tasks = import_tasks
        self._view = view
        self._source: RunSource | None = None
        self._finished_at: dict[str, float] = {}

    @property
    def items(self) -> Sequence[Item]:
        """The finished episodes."""
        return [] if self._source is None else self._source.items

    def load(self, item: str) -> Trajectory:
        """Play the targets of a record, and collect the poses."""
        if self._source is None:
            raise AssertionError("Nothing is finished.")
        return self._source.load(item)

    def close(self) -> None:
        """Free the environment."""
        if self._source is not None:
            self._source.close()

    def refresh(self, is_last: bool = False) -> dict[str, Any]:
        """Return what the page shows of the run now; its report once the run or this ends."""
        try:
            shown: dict[str, Any] = {"run": self._read()}
        except (
            DuoBenchError,
            OSError,
        ) as error:  # it is begun anew, or something is broken
            shown = {"run": {"note": f"The run cannot be read now: {error}"}}
        if self._folder.page.exists() and (is_last or self._is_over()):
            base = self._server.publish_folder(self._folder.path)
            shown["report"] = base + self._folder.page.name
        elif is_last:
            shown |= {
                "ended": True,
                "run": {"note": "This page has ended. There is no report."},
            }
        return shown

    def wait_for_visitors(self) -> None:
        """Wait until all have loaded the report, a moment at most."""
        deadline = time.monotonic() + _LEAVING_S
        while self._server.has_viewers and time.monotonic() < deadline:
            time.sleep(_LOOK_S)
        time.sleep(_LOADING_S if self._folder.page.exists() else 0.0)

    def _read(self) -> dict[str, Any]:
        if not self._folder.description.exists():
            return {"note": "Nothing is written yet."}
        if self._source is None:
            self._source = RunSource(
                self._folder,
                self._look,
                self._tasks,
                import_tasks=self._import_tasks,
                view=self._view,
            )
            self.title = self._source.title
        source = self._source
        source.refresh()
        for name, record in source.records.items():
            if name not in self._finished_at:
                self._finished_at[name] = (
                    self._folder.record(record.key).stat().st_mtime
                )
        times = sorted(self._finished_at[name] for name in source.records)
        began, is_whole = (
            self._folder.description.stat().st_mtime,
            len(times) == source.run.size,
        )
        parts = group_by_condition(source.run, source.records.values())
        rows = [
            {
                "condition": part.condition.name if len(parts) > 1 else "",
                "task": one.task.id,
                "of": source.run.suite.episodes,
                **one.score.numbers(),
            }
            for part in parts
            for one in part.results.tasks
        ]
        latest = sorted(source.items, key=lambda item: -self._finished_at[item.id])
        failed = [item for item in latest if item.state in {FAILURE, ERROR}][:FAILURES]
        return {
            "finished": len(times),
            "of": source.run.size,
            "elapsed_s": sum(
                _gaps([began, *times, *([] if is_whole else [time.time()])])
            ),
            "left_s": _left_s(times, source.run.size),
            "rows": rows,
            "failures": [{"id": each.id, "title": each.title} for each in failed],
        }

    def _is_over(self) -> bool:
        """Whether every episode has a record, and the report is newer than the last of them."""
        source = self._source
        if source is None or len(source.records) < source.run.size:
            return False
        return self._folder.page.stat().st_mtime >= max(
            self._finished_at.values(), default=0.0
        )


ViewSource = TaskSource | DataSource | RunSource | FollowedRun
"""Episodes to view; they are loaded, and what they hold is freed, in one thread."""


def open_view(
    what: str,
    look: str | Look = DEFAULT,
    tasks: Sequence[str] = (),
    *,
    import_tasks: bool = False,
    view: View | None = None,
    gripper: str = DEFAULT_GRIPPER,
) -> ViewSource:
    """Return the source that a word names: a data set, a run or a bundle by its path, or a task.

    Args:
        what: Folder or file, id of a task, or its import path.
        look: How it looks.
        tasks: Only the episodes of these tasks; of all if none is named.
        import_tasks: See `RunSource`.
        view: Where the page looks from at first; None is the task's overview.
        gripper: Gripper with which a task is shown.
    """
    path = Path(what)
    if (path / DATA_SET).exists():
        source = DataSource(
            DataSet.open(
                path,
                create=False,
                import_tasks=import_tasks,
                own_tasks=catalog.import_paths(tasks),
            ),
            look,
            tasks,
            view,
        )
    elif path.is_file() or (path / RUN).exists():
        source = RunSource(
            open_source(path),
            look,
            tasks,
            import_tasks=import_tasks,
            view=view,
        )
    elif path.exists() and catalog.plain(what) not in catalog.names():
        raise EvaluationError(
            f"{what} holds neither a data set ({DATA_SET}) nor an evaluation ({RUN})."
        )
    else:
        return TaskSource(what, look, view, gripper)
    if not source.items:
        raise EvaluationError(f"{what} has no finished episode to view.")
    return source


def _picture_of(
    simulation: Simulation,
    task: Task,
    info: EpisodeInfo,
) -> Callable[[Recording, int], None]:
    """Return what shows real arms where they were measured, with grippers open.

    Objects stand where the layout asked for them.
    """
    if info.seed is not None and info.split is not None:
        simulation.apply(next(task.layouts(info.seed, info.split)))

    def show(recording: Recording, row: int) -> None:
        """Show the arms of one row."""
        joints = np.delete(recording.agent_pos[row], OPENING_SLOTS)
        command = DuoCommand(
            joints=joints.reshape(len(SIDES), -1),
            openings=np.ones(2),
        )
        simulation.duo.set_configuration(command)
        simulation.forward()

    return show


def _in_words(corrections: Sequence[tuple[int, int, str]]) -> str:
    """Corrections as a sentence."""
    parts = [
        f"{begin / CONTROL_HZ:.1f} to {end / CONTROL_HZ:.1f} s"
        + (f" ({why})" if why else "")
        for begin, end, why in corrections
    ]
    return f"Taken over from the policy: {', '.join(parts)}."


def _recorded(name: str, take: Take) -> Item:
    """A take as the page lists it."""
    return Item(
        id=name,
        title=name.replace("/", " "),
        detail=str(take),
        state=take.end if take.kept else UNUSED,
        take=take,
    )


def _finished(name: str, record: Record) -> Item:
    state = end_of(record)
    detail = f"{state}, stage {record.final_stage} of {record.max_stage}"
    return Item(
        id=name, title=f"{record.task} {record.episode}", detail=detail, state=state
    )


def _gaps(moments: Sequence[float]) -> list[float]:
    """Seconds between moments, one after the other, without breaks."""
    return [gap for a, b in pairwise(moments) if 0.0 <= (gap := b - a) <= _BREAK_S]


def _left_s(times: Sequence[float], size: int) -> float | None:
    """Seconds until the rest is finished at the pace of the latest episodes; None if unknown."""
    gaps = _gaps(times[-_LATEST:])
    if not gaps:
        return 0.0 if len(times) == size else None
    return (size - len(times)) * sum(gaps) / len(gaps)
