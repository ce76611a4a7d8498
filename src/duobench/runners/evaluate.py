"""Running an evaluation: what is missing in a folder is played, then everything is reported.

Whatever plays, this process alone writes what it plays. Other processes may write other shards of
the same run into the same folder.
"""

from collections.abc import Sequence, Set
from contextlib import closing
from dataclasses import replace
from itertools import chain

from duobench.errors import EvaluationError
from duobench.evaluation.episode import Job
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.rollout import Observer
from duobench.results.attempts import POLICY
from duobench.results.folder import RunFolder
from duobench.results.journal import Journal
from duobench.results.records import EpisodeRecord, Key
from duobench.results.report import write_report
from duobench.results.run import WHOLE, Run, Shard, TimeLimits
from duobench.results.salt import Salt
from duobench.results.scores import Results, summarize
from duobench.results.suite import Episode, Suite
from duobench.runners.executor import executor_for
from duobench.runners.ray_process import Cluster
from duobench.runners.schedule import AttemptLog, check_played


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
    shard: Shard = WHOLE,
    cluster: Cluster | None = None,
    salt: Salt | None = None,
) -> Results:
    """Play the episodes of a suite that have no record yet, and write the report.

    The results do not depend on the number of workers, on the order in which episodes finish, on
    how often the run was stopped and started again, or on how many processes play its shards.

    Args:
        policy: `expert`, a baseline's name, `module:attribute`, or a choice that also says
            whether it plays in batches or at a server.
        suite: What to play, under every shift that it names.
        folder: Where everything is written; a folder that holds the same run is continued.
        videos: How many episodes of each task and shift, from the first on, have a video.
        limits: How long the policy may take.
        workers: Processes that play side by side. With 0 this process plays: fine for a debugger,
            but it cannot stop a policy that hangs or outlive one that ends its process.
        observers: Called about the progress, in this process.
        retry_broken: Also play the episodes again whose records hold an error.
        fresh: Remove what a run has left in the folder, whatever it was, and play everything; of
            the same run, what this shard has left. A run of which every finished episode failed
            with an error gives way to another one anyway; attempts at its episodes stay on record.
        unplayed_count_as_failures: Write records with an error for episodes that cannot be played
            because a process dies in them each time.
        command: The command that starts it, for the report.
        shard: Which part of the episodes is played. All parts may be played into one folder, or
            into several that are copied into one. What finishes the run writes the report.
        cluster: The Ray cluster on which workers and policy are; None for this machine alone.
        salt: The secret that seeds of episodes and policy follow from; it stays in this process.
            None plays the public ones.

    Returns:
        What the records add up to: of the shard, under all shifts.

    Raises:
        EvaluationError: If the number of workers is negative, episodes cannot be played
            (`MachineryError`, `UnplayedError`), or records are missing at the end.
        OtherRunError: If the folder holds another run.
        OutputError: If the folder cannot be written, or the shard is being written.
        FileError: If a record is broken.
        PolicyError: If the policy cannot be made, or does not fit the environment.
        DuoBenchError: If the environment cannot be made.
    """
    choice = PolicyChoice.parse(policy) if isinstance(policy, str) else policy
    suite = replace(suite, salt=salt and salt.sha256)
    folder.salt = salt
    job = Job(policy=choice, suite=suite, limits=limits or TimeLimits(), videos=videos)
    executor = executor_for(job, workers, cluster)
    with folder.writer(shard) as journal, closing(executor):
        run = executor.prepare()
        if fresh:
            folder.clear(run, shard)
            journal.clear()
        elif folder.gives_way(run):
            folder.clear(run, shard, keeps_attempts=True)
        episodes = run.episodes(shard, videos, salt)
        if episodes and not folder.has_records:
            executor.rehearse(episodes[0])
        folder.begin(run, shard)
        journal.start(command, workers)
        finished = _finished(folder, run, shard, retry_broken=retry_broken)
        for observer in observers:
            observer.on_run_start(run, finished)
        records = {record.key: record for record in finished}
        missing = [each for each in episodes if run.key(each) not in records]
        results = executor.play(missing, _NotedAttempts(run, journal))
        if unplayed_count_as_failures:
            results = chain(results, executor.failures())
        for result in results:
            earlier = journal.earlier(result.record.key)
            record = replace(result.record, attempt=1 + len(earlier), earlier=earlier)
            records[record.key] = record
            folder.write(record, result.video)
            journal.end(record, result.times)
            for observer in observers:
                observer.on_episode(record)
        given_up = {
            each: why for each, why in executor.unplayed.items() if run.key(each) not in records
        }
        there = _report(folder, shard)
        check_played(given_up, has_shifts=len(suite.shifts) > 1)
        _check_complete(folder, set(run.episode_keys(shard)), there)
    return summarize(suite.tasks, list(records.values()))


class _NotedAttempts(AttemptLog):
    """Attempts that a journal notes, and those that it knows."""

    def __init__(self, run: Run, journal: Journal) -> None:
        super().__init__()
        self._run, self._journal = run, journal

    def begin(self, episode: Episode) -> None:
        self._journal.begin(self._run.key(episode))

    def lose(self, episode: Episode, how: str) -> None:
        self._journal.lose(self._run.key(episode), how)

    def policy_ends(self, episode: Episode) -> int:
        return self._journal.earlier(self._run.key(episode)).count(POLICY)


def _finished(
    folder: RunFolder, run: Run, shard: Shard, *, retry_broken: bool
) -> list[EpisodeRecord]:
    finished = folder.read_records(folder.read_run(), set(run.episode_keys(shard)))
    if retry_broken:
        for record in finished:
            if record.error is not None:
                folder.discard(record.key)
        finished = [record for record in finished if record.error is None]
    return finished


def _report(folder: RunFolder, shard: Shard) -> list[Key]:
    """Report a run that is finished, or played by one alone; give what has a record."""
    run = folder.read_run()
    there = folder.finished(run)
    if shard.is_whole or len(there) == run.size:
        write_report(folder)
    return there


def _check_complete(folder: RunFolder, ours: Set[Key], there: Sequence[Key]) -> None:
    """Reject a folder in which records of a shard are missing that were played."""
    if missing := ours - set(there):
        raise EvaluationError(
            f"{len(missing)} of {len(ours)} records are missing from {folder.path} although "
            "their episodes were played: somebody has removed them. Run the evaluation again: it "
            "plays what is missing."
        )
