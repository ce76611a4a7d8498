"""Running an evaluation: what is missing in a folder is played, then everything is reported.

Whatever plays, this process alone writes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace

from duobench.errors import EvaluationError, UnplayedError
from duobench.evaluation.episode import EpisodeResult, Job
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.rollout import Observer
from duobench.files import locked
from duobench.results.folder import RunFolder
from duobench.results.limits import TimeLimits
from duobench.results.metrics import Results
from duobench.results.records import EpisodeRecord
from duobench.results.report import write_report
from duobench.results.run import Run
from duobench.results.suite import Episode, Suite
from duobench.results.suites.shard import Shard
from duobench.runners.executor import executor_for
from duobench.runners.ray_cluster import Cluster


def evaluate(  # noqa: PLR0913
    policy: str | PolicyChoice,
    suite: Suite,
    folder: RunFolder,
    *,
    videos: int = 0,
    limits: TimeLimits | None = None,
    workers: int = 1,
    observers: Sequence[Observer[EpisodeRecord]] = (),
    retry_broken: bool = False,
    fresh: bool = False,
    unplayed_count_as_failures: bool = False,
    command: str = "",
    shard: Shard | None = None,
    cluster: Cluster | None = None,
) -> Results:
    """Play the episodes of a suite that have no record yet, and write the report.

    The results do not depend on the number of workers, on the order in which episodes finish, or
    on how often the run was stopped and started again.

    Args:
        policy: `expert`, a baseline's name, `module:attribute`, or a choice that also says
            whether it plays in batches or at a server.
        suite: What to play.
        folder: Where everything is written; a folder that holds the same run is continued.
        videos: How many episodes of each task, from the first on, have a video.
        limits: How long the policy may take.
        workers: Processes that play side by side. With 0 this process plays: fine for a debugger,
            but it cannot stop a policy that hangs or outlive one that ends its process.
        observers: Called about the progress, in this process.
        retry_broken: Also play the episodes again whose records hold an error.
        fresh: Remove what a run has left in the folder, whatever it was, and play everything. A run
            of which every finished episode failed with an error gives way to another one anyway.
        unplayed_count_as_failures: Write records with an error for episodes that cannot be played
            because a process dies in them each time.
        command: The command that starts the run, for its description and the report.
        shard: Which part of the episodes is played; None plays all. Each part has a folder of its
            own, and `open_sources` reads all parts as one run.
        cluster: The Ray cluster on which workers and policy are; None for this machine alone.

    Returns:
        What all records of the run add up to.

    Raises:
        EvaluationError: If the number of workers is negative, episodes cannot be played
            (`MachineryError`, `UnplayedError`), or records are missing at the end.
        OtherRunError: If the folder holds another run.
        OutputError: If the folder cannot be written, or is in use.
        FileError: If a record is broken.
        PolicyError: If the policy cannot be made, or does not fit the environment.
        DuoBenchError: If the environment cannot be made.
    """
    choice = PolicyChoice.parse(policy) if isinstance(policy, str) else policy
    limits = limits or TimeLimits()
    job = Job(policy=choice, suite=suite, limits=limits, videos=videos, command=command)
    executor = executor_for(job, workers, cluster)
    with locked(folder.path), closing(executor):
        run = replace(executor.prepare(), shard=shard)
        if fresh or folder.has_only_errors_of_another(run):
            folder.clear()
        if run.size and not folder.has_records:
            executor.rehearse(run.episodes()[0])
        folder.begin(run)
        finished = _finished(folder, run, retry_broken=retry_broken)
        for observer in observers:
            observer.on_run_start(run, finished)
        done = {(record.task, record.episode) for record in finished}
        missing = [each for each in run.episodes() if (each.task.id, each.index) not in done]
        for result in executor.play(missing):
            _write(folder, result, observers, workers)
        unplayed = executor.unplayed
        if unplayed_count_as_failures:
            for result in executor.failures():
                _write(folder, result, observers, workers)
            unplayed = {}
        results = write_report(folder)
        _check_complete(folder, run, results, unplayed)
        return results


def _finished(folder: RunFolder, run: Run, *, retry_broken: bool) -> list[EpisodeRecord]:
    """The records that stay, of those that are there."""
    finished = folder.read_records(run)
    if retry_broken:
        for record in finished:
            if record.error is not None:
                folder.discard(record)
        finished = [record for record in finished if record.error is None]
    return finished


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


def _check_complete(
    folder: RunFolder, run: Run, results: Results, unplayed: Mapping[Episode, str]
) -> None:
    """Say which episodes have no record, and why.

    Raises:
        UnplayedError: They could not be played.
        EvaluationError: They were removed.
    """
    if unplayed:
        raise UnplayedError.of(
            {f"{each.task.id}, episode {each.index}": why for each, why in unplayed.items()}
        )
    if results.overall.episodes < run.size:
        raise EvaluationError(
            f"{run.size - results.overall.episodes} of {run.size} records are missing from "
            f"{folder.path} although their episodes were played: somebody has removed them. "
            "Run the evaluation again: it plays what is missing."
        )
