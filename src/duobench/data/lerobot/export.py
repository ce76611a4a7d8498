"""Export of a data set: missing episodes are exported, then the metadata is written."""

from collections import Counter
from collections.abc import (
    Callable,
    Collection,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from duobench.core.backend import DEPTH, RGB, CameraGeometry
from duobench.core.codecs import HEVC12
from duobench.core.errors import (
    DataError,
    NoSuccessesError,
    OtherRunError,
    SeveralTasksError,
    check_known,
)
from duobench.core.files import (
    check_outside,
    check_there,
    digest_of,
    encode,
    locked,
    replacing,
    write,
)
from duobench.core.lerobot_keys import (
    ACTION,
    DOMAIN,
    DOMAINS,
    OBJECT_STATE,
    RECORDING_ROW,
    STATE,
)
from duobench.core.processes import Progress, run_all
from duobench.core.randomness import EVAL, SUITE_VERSION, look_number
from duobench.core.types import Array
from duobench.core.versions import package_versions
from duobench.core.video import Frame, VideoWriter
from duobench.data.dataset import DataSet
from duobench.data.images import (
    ImageSource,
    RecordedImages,
    ViewOf,
    check_cameras,
    plain_view,
)
from duobench.data.lerobot.actions import labels_of
from duobench.data.lerobot.depth import encoded
from duobench.data.lerobot.folder import (
    POSE,
    SCHEMA,
    EpisodeFacts,
    Export,
    ExportFolder,
    Residual,
    SourceEpisode,
    Vectors,
    schema,
)
from duobench.data.lerobot.metadata import (
    Counts,
    count_values,
    finish,
    no_counts,
)
from duobench.data.lerobot.options import ActionSource, ExportOptions
from duobench.data.recording import Recording, to_arrow, to_bytes
from duobench.data.reviews import Judgement, Review, joined
from duobench.data.rewards import rewards_of
from duobench.data.schema import Domain, EpisodeInfo
from duobench.data.used_rows import Reason, Steps, used_rows
from duobench.envs.action_modes import CARTESIAN, JOINT
from duobench.envs.camera_options import name_of
from duobench.envs.rewards import DENSE, PROGRESS, STAGE
from duobench.tasks import catalog
from duobench.world.looks.catalog import RANDOM
from duobench.world.robot.cameras import describe_cameras
from duobench.world.robot.frames import USUAL_ROBOT, Robot
from duobench.world.sim import rendering

_Job = tuple[ExportFolder, int]
"""An episode to export: the folder, and its number there."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Exported:
    """Outcome of an export."""

    episodes: int
    frames: int
    """Number of rows of all of them."""
    left_out: int
    """Episodes of the data set that are not in it."""
    failures: int = 0
    """Those among them that a person led and kept without success; the options leave them out."""
    rows_left_out: dict[Reason, int] = field(default_factory=dict)
    """Rows of its episodes that are not in it, for each reason."""
    residual: Residual | None
    eval_layouts: int
    """Episodes in it with layouts of the evaluation's split."""


def export_lerobot(
    data: DataSet | Sequence[DataSet],
    out: Path,
    options: ExportOptions | None = None,
    *,
    per_task: bool = False,
    workers: int = 1,
    progress: Progress = lambda _done, _total: None,
    view_of: ViewOf = plain_view,
) -> Exported:
    """Export data sets to LeRobot's format v3.0 or v2.1; continues where it was stopped.

    Images of simulated episodes are rendered from states, those of real ones read from their
    videos. The column `domain` says which row is from where.

    What is written does not depend on the number of workers or on interruptions. Episodes that were
    discarded, when they were recorded or at a second look, are left out, as are rows that were
    trimmed; what is there twice is exported once.

    Args:
        data: The data set, or several.
        out: Folder of the export, new or holding the same export.
        options: What is exported.
        per_task: Whether each task becomes a data set of its own, in a folder of its name in `out`.
        workers: Processes that render and encode side by side, which are started anew (`spawn`); 0
            does everything in this process.
        progress: Told about the progress in frames, at first and after every episode.
        view_of: Gives the view of each real camera, which makes its images those of the
            simulation's camera; it can be pickled.

    Raises:
        DataError: There is nothing to export, or a recording cannot be read or shown.
        NoSuccessesError: There are only failures of people, which the options leave out.
        SeveralTasksError: Tasks whose object states differ are to be in one data set.
        OtherRunError: The folder holds something else.
        OutputError: Nothing can be written into the folder.
        UnknownNameError: A task has no episode in the data set.
    """
    options, out = options or ExportOptions(), out.absolute()
    sources = [data] if isinstance(data, DataSet) else list(data)
    check_outside(out, *(source.path for source in sources))
    paths = _episodes(sources, options.tasks)
    parts = {out: paths}
    if per_task and ExportFolder(out).meta.exists():
        raise OtherRunError(
            f"{out} holds one data set of its own; export a data set for each task into another "
            "folder."
        )
    if per_task and paths:
        tasks = sorted({path.parent.name for _, path in paths})
        parts = {
            out / task: [one for one in paths if one[1].parent.name == task]
            for task in tasks
        }
    plans = {
        ExportFolder(folder, options.format): _plan(sources, part, options)
        for folder, part in parts.items()
    }
    with ExitStack() as locks:
        for folder, export in plans.items():
            locks.enter_context(locked(folder.path))
            folder.begin(export)
        _export_all(
            partial(_exporter, sources, plans, view_of), plans, workers, progress
        )
        residuals = [
            one for folder, export in plans.items() for one in finish(folder, export)
        ]
    episodes = sum(len(export.episodes) for export in plans.values())
    return Exported(
        episodes=episodes,
        frames=sum(export.frames for export in plans.values()),
        left_out=len(paths) - sum(export.recordings for export in plans.values()),
        failures=sum(export.failures for export in plans.values()),
        rows_left_out=dict(
            sum((Counter(plan.left_out) for plan in plans.values()), Counter())
        ),
        eval_layouts=sum(
            one.split == EVAL for plan in plans.values() for one in plan.episodes
        ),
        residual=sum(residuals, Residual()) if residuals else None,
    )


def _episodes(
    sources: Sequence[DataSet], tasks: Collection[str]
) -> list[tuple[int, Path]]:
    """Files of the episodes of some tasks, each with the number of its data set."""
    if not sources:
        raise DataError("There is nothing to export; name at least one data set.")
    known = sorted({task for source in sources for task in source.tasks})
    wanted = {catalog.id_of(task) for task in tasks}
    for task in wanted:
        check_known("task in the data set", task, known)
    return [
        (number, path)
        for number, source in enumerate(sources)
        for path in source.episodes()
        if not wanted or path.parent.name in wanted
    ]


def _plan(
    sources: Sequence[DataSet],
    paths: Sequence[tuple[int, Path]],
    options: ExportOptions,
) -> Export:
    """Plan of an export into one folder; every recording is read to the end."""
    episodes = []
    tasks = set()
    robots = dict[Robot, str]()
    digests = set[str]()
    failures = 0
    emptied: list[str] = []
    judgements = _judgements(sources, paths)
    for number, path in paths:
        recording, digest = _read(path, options), digest_of(path)
        judgement = judgements[path]
        info = judgement.judged(recording.info)
        is_wanted = _is_wanted(info, options) and len(recording) > 0
        if is_wanted and info.is_led_failure and not options.keep_failures:
            failures += 1
        elif is_wanted and digest not in digests:
            digests.add(digest)
            _check(recording, options, path)
            task = sources[number].reference(info)
            used = used_rows(
                recording,
                options,
                task,
                within=judgement.rows,
            )
            stretches = used.stretches()
            if not stretches:
                emptied.append(" and ".join(used.left_out))
            for rows in stretches:
                robots[info.robot] = info.other_robot
                tasks.add(task)
                episodes.append(
                    SourceEpisode(
                        file=path.relative_to(sources[number].path).as_posix(),
                        sha256=digest,
                        length=len(rows.steps(options.every)),
                        rows=rows,
                        instruction=recording.info.instruction,
                        data_set=number,
                        domain=recording.info.domain,
                        split=recording.info.split,
                        look=_own_look(recording, path, options),
                    )
                )
    if not episodes:
        where = ", ".join(dict.fromkeys(path.parent.name for _, path in paths))
        names = " and ".join(str(source.path) for source in sources)
        holds = "holds" if len(sources) == 1 else "hold"
        told = f"{names} {holds} no episode to export, of {len(paths)} that were read"
        told = f"{told} ({where})." if where else f"{told}."
        if emptied:
            why = ", ".join(dict.fromkeys(emptied))
            told += f" In {len(emptied)} every row is left out: {why}."
        if failures:
            raise NoSuccessesError(
                f"{told} Of these, {failures} that people led did not succeed."
            )
        raise DataError(told)
    if len(robots) > 1:
        raise DataError(
            "The episodes were recorded with different grippers or mounts: "
            f"{', '.join(name or USUAL_ROBOT for name in robots.values())}. Export each into a "
            "folder of its own."
        )
    ((robot, name),) = robots.items()
    return Export(
        options=options,
        suite_version=SUITE_VERSION,
        versions=package_versions(),
        episodes=tuple(episodes),
        failures=failures,
        object_state_names=_object_state_names(tasks) if options.object_state else (),
        cameras=describe_cameras(robot.gripper),
        robot=name,
    )


def _judgements(
    sources: Sequence[DataSet],
    paths: Sequence[tuple[int, Path]],
) -> dict[Path, Judgement]:
    """What stands about each file; all that is said about its copies is about it too."""
    logs = [source.reviews for source in sources]
    copies: dict[str, dict[Path, list[Review]]] = {}
    for number, path in paths:
        of_copies = copies.setdefault(Recording.read_checksum(path), {})
        of_copies[path] = logs[number].about(path)
    return {
        path: Judgement.of(joined(of_copies.values()))
        for of_copies in copies.values()
        for path in of_copies
    }


def _read(path: Path, options: ExportOptions) -> Recording:
    """An episode as far as it is exported."""
    recording = Recording.read(path)
    return recording if options.after_success else recording.until(recording.steps)


def _own_look(
    recording: Recording,
    path: Path,
    options: ExportOptions,
) -> str | None:
    """The look of an episode where each has its own; None where it has that of all, or videos."""
    info, number = recording.info, options.look_numbers
    if number is None or info.is_real or not options.seen:
        return None
    return f"{RANDOM}{look_number(info.task, info.seed, path.name, number)}"


def _object_state_names(tasks: Collection[str]) -> tuple[str, ...]:
    names = {catalog.get(task).object_state.names for task in tasks}
    if len(names) > 1:
        raise SeveralTasksError(
            f"The object states of {', '.join(sorted(tasks))} are other numbers each, which one "
            "data set of LeRobot cannot hold; export each task into a folder of its own."
        )
    return names.pop()


def _export_all(
    make: Callable[[], Callable[[_Job], _Job]],
    plans: Mapping[ExportFolder, Export],
    workers: int,
    progress: Progress,
) -> None:
    jobs = {
        (folder, index): episode
        for folder, export in plans.items()
        for index, episode in enumerate(export.episodes)
        if not folder.is_finished(index, export.options.videos)
    }
    total = sum(export.frames for export in plans.values())
    done = total - sum(episode.length for episode in jobs.values())
    progress(done, total)
    if any(
        plans[folder].options.seen and episode.domain is Domain.SIM
        for (folder, _), episode in jobs.items()
    ):
        rendering.choose(processes=max(1, workers))
    with closing(run_all(make, list(jobs), workers)) as finished:
        for job in finished:
            done += jobs[job].length
            progress(done, total)


def _is_wanted(info: EpisodeInfo, options: ExportOptions) -> bool:
    """Whether an episode is exported: it is finished, was kept, and is none that options forbid."""
    outcome = info.outcome
    if outcome is None or (options.only_successes and not outcome.success):
        return False
    return outcome.kept and info.domain in options.domains


def _check(
    recording: Recording,
    options: ExportOptions,
    path: Path,
) -> None:
    """Reject now what would stop the export later, and what is of another suite."""
    suite = recording.info.suite_version
    if suite != SUITE_VERSION and not recording.info.is_real:
        raise DataError(
            f"{path} is of suite {suite}; this version exports suite {SUITE_VERSION}, whose "
            "layouts and objects are others."
        )
    mode = recording.info.mode
    is_target = mode in (JOINT, CARTESIAN) or mode.name == options.action
    if options.action_source is ActionSource.GIVEN and not is_target:
        raise DataError(
            f"{path}: actions of mode {mode.name!r} name no targets of joints or tools; export "
            f"{ActionSource.SENT.value!r} actions."
        )
    if recording.info.is_real:
        if options.object_state:
            raise DataError(
                f"{path}: where the objects were on the real table is not known."
            )
        if options.depth or options.geometry:
            raise DataError(
                f"{path} was recorded on real arms, as videos alone: neither depth nor where "
                "cameras were is known of its rows. Export the domain sim alone."
            )
        if options.reward == DENSE:
            raise DataError(
                f"{path} was played on real arms, where nothing measures the reward {DENSE!r}; "
                f"{PROGRESS!r} and {STAGE!r} are known."
            )
        check_cameras(recording, path, [name_of(each) for each in options.cameras])


def _exporter(
    sources: Sequence[DataSet], plans: Mapping[ExportFolder, Export], view_of: ViewOf
) -> Callable[[_Job], _Job]:
    """Exporter of one episode after the other; it keeps the model of a task."""
    options = next(iter(plans.values())).options
    depth_of = options.depth_of
    source_of = lru_cache(maxsize=1)(
        partial(
            ImageSource,
            cameras=options.cameras,
            size=options.size,
            depth=list(depth_of.values()),
        )
    )

    def export_one(job: _Job) -> _Job:
        folder, index = job
        export = plans[folder]
        episode = export.episodes[index]
        path = sources[episode.data_set].path / episode.file
        recording = _read(path, options)
        if digest_of(path) != episode.sha256:
            raise DataError(
                f"{path} has changed since the export began; begin it anew."
            )
        steps = episode.rows.steps(options.every)
        actions, residual = labels_of(
            recording, options.action, options.action_source, steps
        )
        counts = {name: no_counts(is_depth=name in depth_of) for name in options.videos}
        shown = (steps.rows + options.pairing.offset).tolist()
        source = None
        if not recording.info.is_real and options.shows_states:
            source = source_of(sources[episode.data_set].reference(recording.info))
            source.set_look(episode.look or options.look)
        try:
            rewards = rewards_of(recording, options.reward, source)
        except DataError as error:
            raise DataError(f"{path}: {error}") from error
        columns = _rows(recording, steps, actions, rewards, export, index)
        if options.videos:
            paths = {name: folder.video(name, index) for name in options.videos}
            with ExitStack() as ending:
                if source is None:
                    recorded = RecordedImages(
                        recording,
                        path,
                        list(options.videos),
                        options.size,
                        view_of,
                    )
                    images = ending.enter_context(closing(recorded)).images
                else:
                    images = partial(_seen, source, depth_of, recording)
                write_videos(_frames(images, shown, counts), paths, options)
        if source is not None and OBJECT_STATE in export.vectors:
            columns[OBJECT_STATE] = np.array(
                [source.objects(recording, row) for row in shown]
            )
        cameras = {}
        if source is not None and options.geometry:
            placed = [source.geometry(recording, row) for row in shown]
            cameras = _described(placed, columns, export.vectors)
        described = schema(export.vectors, options.format)
        arrays = [to_arrow(columns[name]) for name in described.names]
        check_there(folder.meta)
        write(
            folder.data(index), to_bytes(pa.Table.from_arrays(arrays, schema=described))
        )
        facts = EpisodeFacts(
            counts={name: values.tolist() for name, values in counts.items()},
            residual=residual,
            sizes=folder.sizes(index, options.videos),
            cameras=cameras,
        )
        write(folder.facts(index), encode(facts, SCHEMA))
        return job

    return export_one


def _seen(
    source: ImageSource, depth_of: Mapping[str, str], recording: Recording, row: int
) -> dict[str, Frame]:
    """Frames of a row by the names of their videos: images, and codes of depth."""
    images = source.images_by_kind(recording, row)
    codes = {name: encoded(images[DEPTH][of]) for name, of in depth_of.items()}
    return {**images.get(RGB, {}), **codes}


def _described(
    placed: Sequence[Mapping[str, CameraGeometry]],
    columns: dict[str, NDArray[Any]],
    vectors: Vectors,
) -> dict[str, dict[str, Any]]:
    """Describe cameras whose place is known in each row, and add a column for each that moves."""
    cameras: dict[str, dict[str, Any]] = {}
    for name, first in placed[0].items():
        pose: Any = first.table_from_camera.tolist()
        poses = np.array([each[name].table_from_camera.ravel() for each in placed])
        if f"{POSE}{name}" in vectors:
            pose = f"{POSE}{name}"
            columns[pose] = poses.astype(np.float32)
        cameras[name] = {"matrix": first.matrix.tolist(), "table_from_camera": pose}
    return cameras


def _frames(
    frames_of: Callable[[int], Mapping[str, Frame]],
    rows: Iterable[int],
    counts: dict[str, Counts],
) -> Iterator[Mapping[str, Frame]]:
    """The frames of rows, whose values are counted."""
    for row in rows:
        frames = frames_of(row)
        for name, frame in frames.items():
            count_values(counts[name], frame)
        yield frames


def write_videos(
    frames: Iterable[Mapping[str, Frame]],
    paths: Mapping[str, Path],
    options: ExportOptions,
) -> None:
    """Encode videos side by side, some of depth; each is whole or absent after a kill."""
    with ExitStack() as stack:
        writers = {}
        for name, path in paths.items():
            temporary = stack.enter_context(replacing(path))
            codec = HEVC12 if name in options.depth_of else options.codec.encoding
            writers[name] = stack.enter_context(
                closing(VideoWriter(temporary, codec, options.fps))
            )
        for row in frames:
            for name, writer in writers.items():
                writer.add(row[name])


def _rows(
    recording: Recording,
    steps: Steps,
    actions: Array,
    rewards: Array,
    export: Export,
    index: int,
) -> dict[str, NDArray[Any]]:
    """The columns of an episode: its steps, with what was paid until the next one."""
    options = export.options
    length = len(steps)
    number = np.arange(length)
    seen_in = steps.rows + options.pairing.offset
    last = min(recording.steps, int(steps.ends[-1]))
    seen = [
        recording.agent_pos,
        *(getattr(recording, part) for part in options.state),
    ]
    return {
        STATE: np.hstack(seen)[seen_in],
        ACTION: actions.astype(np.float32),
        "next.reward": steps.added(rewards).astype(np.float32),
        "next.done": steps.ends >= last,
        "next.success": recording.success[steps.ends],
        "stage": recording.stage[seen_in],
        DOMAIN: np.full(length, DOMAINS.index(export.episodes[index].domain)),
        RECORDING_ROW: steps.rows,
        "timestamp": (number / options.fps).astype(np.float32),
        "frame_index": number,
        "episode_index": np.full(length, index),
        "index": export.first_row(index) + number,
        "task_index": np.full(length, export.tasks.index(recording.info.instruction)),
    }
