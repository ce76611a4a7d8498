"""The export of a data set: what is missing in a folder is exported, then everything described."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from duobench.backend import Image
from duobench.data.dataset import DataSet
from duobench.data.lerobot import statistics
from duobench.data.lerobot.actions import Residual, joint_targets
from duobench.data.lerobot.features import COLUMNS, FPS, schema
from duobench.data.lerobot.folder import SCHEMA, EpisodeFacts, Export, ExportFolder, SourceEpisode
from duobench.data.lerobot.metadata import finish
from duobench.data.lerobot.options import ActionSource, ExportOptions, Pairing
from duobench.data.processes import Progress, run_all
from duobench.data.recording import Recording, to_arrow, to_bytes
from duobench.data.replay import ImageSource
from duobench.data.schema import action_mode
from duobench.envs.action_modes import CARTESIAN, JOINT
from duobench.errors import DataError
from duobench.files import encode, locked, replacing, write
from duobench.lerobot_keys import ACTION, DOMAIN, DOMAINS, STATE
from duobench.randomness import SUITE_VERSION
from duobench.sim import rendering
from duobench.types import CONTROL_HZ, Array
from duobench.versions import package_versions
from duobench.video import AV1, VideoWriter


@dataclass(frozen=True, kw_only=True, slots=True)
class Exported:
    """What an export came to."""

    episodes: int
    """How many episodes are in it."""
    frames: int
    """How many rows they have together."""
    left_out: int
    """Episodes of the data set that are not in it."""
    residual: Residual | None
    """What inverse kinematics left, if it was used."""


def export_lerobot(
    data: DataSet,
    out: Path,
    options: ExportOptions | None = None,
    *,
    workers: int = 1,
    progress: Progress = lambda _done, _total: None,
) -> Exported:
    """Export a data set to LeRobot's format v3.0; continues where it was stopped.

    What is written does not depend on the number of workers or on interruptions. Episodes that were
    discarded when they were recorded are left out.

    Args:
        data: The data set.
        out: Folder of the export, new or holding the same export.
        options: What is exported.
        workers: Processes that render and encode side by side, which are started anew (`spawn`); 0
            does everything in this process.
        progress: Told about the progress in frames, at first and after every episode.

    Returns:
        What it came to.

    Raises:
        DataError: There is nothing to export, or a recording cannot be read or shown.
        OtherRunError: The folder holds something else.
        OutputError: Nothing can be written into the folder.
        UnknownNameError: A task has no episode in the data set.
    """
    options = options or ExportOptions()
    export, left_out = _plan(data, options)
    folder = ExportFolder(out.absolute())
    if out.resolve().is_relative_to(data.path.resolve()):
        raise DataError(f"{out} lies in the data set; export into a folder of its own.")
    with locked(folder.path):
        folder.begin(export)
        missing = [
            index
            for index in range(len(export.episodes))
            if not folder.is_finished(index, options.cameras)
        ]
        total = sum(episode.length for episode in export.episodes)
        done = total - sum(export.episodes[index].length for index in missing)
        progress(done, total)
        if missing and options.cameras:
            rendering.choose(processes=max(1, workers))
        jobs = run_all(partial(_exporter, data.path, folder, export), missing, workers)
        with closing(jobs) as finished:
            for index in finished:
                done += export.episodes[index].length
                progress(done, total)
        residual = finish(folder, export)
    return Exported(
        episodes=len(export.episodes), frames=total, left_out=left_out, residual=residual
    )


def _plan(data: DataSet, options: ExportOptions) -> tuple[Export, int]:
    """What to export, and how many episodes are left out; every recording is read to the end."""
    paths = data.episodes_of(options.tasks)
    episodes = []
    for path in paths:
        recording = Recording.read(path)
        if _is_wanted(recording, options):
            _check(recording, options, path)
            episodes.append(
                SourceEpisode(
                    file=path.relative_to(data.path).as_posix(),
                    sha256=_hash_of(path),
                    length=len(recording),
                    instruction=recording.info.instruction,
                )
            )
    if not episodes:
        raise DataError(f"{data.path} holds no episode to export, of {len(paths)} that were read.")
    export = Export(
        options=options,
        suite_version=SUITE_VERSION,
        versions=package_versions(),
        episodes=tuple(episodes),
    )
    return export, len(paths) - len(episodes)


def _is_wanted(recording: Recording, options: ExportOptions) -> bool:
    """Whether an episode is exported: it is finished, was kept, and has actions."""
    outcome = recording.info.outcome
    if outcome is None or not outcome.kept or not len(recording):
        return False
    return outcome.success or not options.only_successes


def _check(recording: Recording, options: ExportOptions, path: Path) -> None:
    """Reject now what would stop the export later."""
    mode = action_mode(recording.info)
    if options.action is ActionSource.GIVEN and mode not in (JOINT, CARTESIAN):
        raise DataError(
            f"{path}: actions of mode {mode.name!r} name no targets of joints or tools; export "
            f"{ActionSource.SENT.value!r} actions."
        )


def _exporter(data: Path, folder: ExportFolder, export: Export) -> Callable[[int], int]:
    """What exports one episode after the other, by index; it keeps the model of a task."""
    options = export.options
    source_of = lru_cache(maxsize=1)(
        partial(ImageSource, cameras=options.cameras, size=options.size, look=options.look)
    )

    def export_one(index: int) -> int:
        episode = export.episodes[index]
        path = data / episode.file
        recording = Recording.read(path)
        if _hash_of(path) != episode.sha256:
            raise DataError(f"{path} has changed since the export began; begin it anew.")
        actions, residual = joint_targets(recording, options.action)
        counts = {camera: statistics.no_counts() for camera in options.cameras}
        if options.cameras:
            paths = {camera: folder.video(camera, index) for camera in options.cameras}
            source = source_of(recording.info.task)
            frames = _frames(source, recording, _offset(options), counts)
            write_videos(frames, paths)
        columns = _rows(recording, actions, export, index)
        arrays = [to_arrow(columns[name]) for name in COLUMNS]
        write(folder.data(index), to_bytes(pa.Table.from_arrays(arrays, schema=schema())))
        noted = {camera: values.tolist() for camera, values in counts.items()}
        facts = EpisodeFacts(counts=noted, residual=residual)
        write(folder.facts(index), encode(facts, SCHEMA))
        return index

    return export_one


def _frames(
    source: ImageSource, recording: Recording, offset: int, counts: dict[str, statistics.Counts]
) -> Iterator[dict[str, Image]]:
    """Render the images of every row, and count their values."""
    for row in range(offset, offset + len(recording)):
        images = source.images(recording, row)
        for camera, image in images.items():
            statistics.count_values(counts[camera], image)
        yield images


def write_videos(frames: Iterable[Mapping[str, Image]], paths: Mapping[str, Path]) -> None:
    """Encode one video a camera side by side; each is whole or absent after a kill.

    Args:
        frames: Images (height, width, 3), both even, by camera, frame by frame.
        paths: Where the video of each camera will be.

    Raises:
        VideoError: The images cannot be encoded.
        OutputError: A file cannot be written.
    """
    with ExitStack() as stack:
        writers = {}
        for camera, path in paths.items():
            temporary = stack.enter_context(replacing(path))
            writers[camera] = stack.enter_context(closing(VideoWriter(temporary, AV1, FPS)))
        for images in frames:
            for camera, writer in writers.items():
                writer.add(images[camera])


def _hash_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _rows(
    recording: Recording, actions: Array, export: Export, index: int
) -> dict[str, NDArray[Any]]:
    """The columns of an episode, one row an action."""
    length, offset = len(recording), _offset(export.options)
    number = np.arange(length)
    return {
        STATE: recording.agent_pos[offset : offset + length],
        ACTION: actions.astype(np.float32),
        "next.reward": recording.reward.astype(np.float32),
        "next.done": number == length - 1,
        "next.success": recording.success[1:],
        "stage": recording.stage[offset : offset + length],
        DOMAIN: np.full(length, DOMAINS.index("sim")),
        "timestamp": (number / CONTROL_HZ).astype(np.float32),
        "frame_index": number,
        "episode_index": np.full(length, index),
        "index": export.first_row(index) + number,
        "task_index": np.full(length, export.tasks.index(recording.info.instruction)),
    }


def _offset(options: ExportOptions) -> int:
    """How many rows after its action's an observation is."""
    return int(options.pairing is Pairing.DELAYED)
