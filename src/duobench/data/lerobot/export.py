"""The export of a data set: what is missing in a folder is exported, then everything described."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from duobench.data.dataset import DataSet
from duobench.data.lerobot.actions import Residual
from duobench.data.lerobot.episode import EpisodeExporter, Job, hash_of
from duobench.data.lerobot.folder import Export, ExportFolder, SourceEpisode
from duobench.data.lerobot.metadata import finish
from duobench.data.lerobot.options import ActionSource, ExportOptions
from duobench.data.processes import run_all
from duobench.data.recording import Recording
from duobench.data.schema import action_mode
from duobench.errors import DataError
from duobench.files import locked
from duobench.randomness import SUITE_VERSION
from duobench.sim import rendering
from duobench.versions import package_versions

Progress = Callable[[int, int], None]
"""Told how many of how many frames are finished."""


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
        progress: Told about the progress, at first and after every episode.

    Returns:
        What it came to.

    Raises:
        DataError: There is nothing to export, a recording cannot be read or shown, or the folder
            holds something else.
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
            job
            for job in _jobs(data, export, folder)
            if not folder.is_finished(job.index, options.cameras)
        ]
        total = sum(episode.length for episode in export.episodes)
        done = total - sum(export.episodes[job.index].length for job in missing)
        progress(done, total)
        if missing and options.cameras:
            rendering.choose(processes=max(1, workers))
        for index in run_all(EpisodeExporter, missing, workers):
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
                    sha256=hash_of(path),
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
    if mode.endswith("_relative") and options.action is ActionSource.GIVEN:
        raise DataError(
            f"{path}: actions of mode {mode!r} are relative to what was commanded "
            f"before and name no targets; export {ActionSource.SENT.value!r} actions."
        )


def _jobs(data: DataSet, export: Export, folder: ExportFolder) -> list[Job]:
    """One job an episode."""
    tasks = {instruction: number for number, instruction in enumerate(export.tasks)}
    jobs, first_row = [], 0
    for index, episode in enumerate(export.episodes):
        jobs.append(
            Job(
                source=data.path / episode.file,
                sha256=episode.sha256,
                folder=folder.path,
                options=export.options,
                index=index,
                first_row=first_row,
                task_index=tasks[episode.instruction],
            )
        )
        first_row += episode.length
    return jobs
