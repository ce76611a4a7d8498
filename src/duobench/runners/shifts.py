"""Playing a suite under many shifts: each condition is a run in a folder of its own.

One executor plays all of them, so that the policy is made once and no worker waits for a condition
to end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

from duobench.errors import UnplayedError
from duobench.evaluation.episode import EpisodeResult, Job
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.rollout import Observer
from duobench.files import locked
from duobench.results.folder import RunFolder
from duobench.results.limits import TimeLimits
from duobench.results.records import EpisodeRecord
from duobench.results.report import write_report
from duobench.results.run import Run
from duobench.results.suite import Episode, Suite
from duobench.results.suites.merged import shard_folder
from duobench.results.suites.shard import Shard
from duobench.runners.executor import executor_for
from duobench.runners.ray_cluster import Cluster
from duobench.shifts.shift import Shift


def evaluate_shifts(  # noqa: PLR0913
    policy: str | PolicyChoice,
    suite: Suite,
    out: Path,
    shifts: Sequence[Shift],
    *,
    limits: TimeLimits | None = None,
    workers: int = 1,
    videos: int = 0,
    observers: Sequence[Observer[EpisodeRecord]] = (),
    command: str = "",
    shard: Shard | None = None,
    retry_broken: bool = False,
    fresh: bool = False,
    cluster: Cluster | None = None,
) -> dict[Shift, RunFolder]:
    """Play the episodes of a suite under shifts, those that have no record yet.

    Args:
        policy: See `evaluate`.
        suite: What is played under each shift.
        out: Folder in which each condition has its own, named as its shift.
        shifts: The conditions.
        limits: How long the policy may take.
        workers: Processes that play side by side; 0 plays in this one.
        videos: How many episodes of each task have a video under each shift, from the first on.
        observers: Called about the progress of all conditions together.
        command: The command that starts the run.
        shard: Which part of each condition is played; None plays all.
        retry_broken: Also play the episodes again whose records hold an error.
        fresh: Remove what runs have left in the folders of these conditions, and play everything.
        cluster: The Ray cluster on which workers and policy are; None for this machine alone.

    Returns:
        The folder of each condition, with its report.

    Raises:
        UnplayedError: Episodes cannot be played.
        OtherRunError: A folder holds another run.
        DuoBenchError: As for `evaluate`.
    """
    choice = PolicyChoice.parse(policy) if isinstance(policy, str) else policy
    folders = {shift: _folder(out / shift.name, shard) for shift in shifts}
    job = Job(
        policy=choice, suite=suite, limits=limits or TimeLimits(), videos=videos, command=command
    )
    executor = executor_for(job, workers, cluster)
    with ExitStack() as ending:
        for folder in folders.values():
            ending.enter_context(locked(folder.path))
        ending.enter_context(closing(executor))
        run = replace(executor.prepare(), shard=shard)
        runs = {shift: run.under(shift) for shift in shifts}
        for folder in folders.values() if fresh else ():
            folder.clear()
        finished = _finished(runs, folders, retry_broken)
        for observer in observers:
            observer.on_run_start(run, finished)
        left = _missing(runs, finished)
        if left:
            executor.rehearse(left[0])
        for shift, folder in folders.items():
            folder.begin(runs[shift])
        for result in executor.play(left):
            _write(folders[result.record.config.shift], result, observers, workers)
        for folder in folders.values():
            write_report(folder)
        if executor.unplayed:
            raise UnplayedError.of(
                {
                    f"{each.task.id}, episode {each.index}, {each.shift}": why
                    for each, why in executor.unplayed.items()
                }
            )
    return folders


def _folder(path: Path, shard: Shard | None) -> RunFolder:
    return RunFolder(path if shard is None else shard_folder(path, shard))


def _finished(
    runs: Mapping[Shift, Run], folders: Mapping[Shift, RunFolder], retry_broken: bool
) -> list[EpisodeRecord]:
    """The records that stay, of those that are there.

    Raises:
        OtherRunError: A folder holds another run.
    """
    finished: list[EpisodeRecord] = []
    for shift, folder in folders.items():
        if not folder.has_records:
            continue
        folder.begin(runs[shift])
        for record in folder.read_records(runs[shift]):
            if retry_broken and record.error is not None:
                folder.discard(record)
            else:
                finished.append(record)
    return finished


def _missing(runs: Mapping[Shift, Run], finished: Sequence[EpisodeRecord]) -> list[Episode]:
    """What has no record yet, task by task, so that a worker stays with a task."""
    done = {(each.task, each.episode, each.config.shift) for each in finished}
    return [
        episode
        for episode in _by_task(runs)
        if (episode.task.id, episode.index, episode.shift) not in done
    ]


def _by_task(runs: Mapping[Shift, Run]) -> Iterator[Episode]:
    episodes = [episode for run in runs.values() for episode in run.episodes()]
    order = {task.id: place for run in runs.values() for place, task in enumerate(run.suite.tasks)}
    yield from sorted(episodes, key=lambda episode: order[episode.task.id])


def _write(
    folder: RunFolder,
    result: EpisodeResult,
    observers: Sequence[Observer[EpisodeRecord]],
    workers: int,
) -> None:
    folder.write(result.record, result.video)
    folder.note_timing(result.record, result.times, workers)
    for observer in observers:
        observer.on_episode(result.record)
