"""Playing the missing episodes of a folder: of an evaluation, or demonstrations.

This process alone writes its episodes, wherever they are played. Other processes may write other
shards of the same evaluation into the same folder. Demonstrations are the first episodes, by
index, that succeed, with any number of workers and after interruptions.
"""

from collections.abc import Sequence, Set
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

from duobench.core.errors import (
    DataError,
    EvaluationError,
    OtherRunError,
    TaskFailedError,
    TooFewSuccessesError,
)
from duobench.core.files import (
    begin_or_continue,
    encode,
    locked,
    read,
    remove_temporary,
    write,
)
from duobench.core.randomness import TRAIN
from duobench.core.types import CONTROL_HZ
from duobench.data import DataSet, Recording
from duobench.data.attempts import (
    ATTEMPTS,
    ATTEMPTS_SCHEMA,
    RUN,
    Attempt,
    Attempts,
)
from duobench.data.dataset import EPISODES, SUFFIX
from duobench.data.schema import AFTER_SUCCESS_S, steps_after_success
from duobench.envs.config import FIXED
from duobench.evaluation.episode import EpisodeResult, Job, RecordingPlan
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.rollouts import Observer
from duobench.evaluation.runners.executor import Executor, executor_for
from duobench.evaluation.runners.ray_process import Cluster
from duobench.evaluation.runners.schedule import AttemptLog, check_played
from duobench.results.attempts import POLICY
from duobench.results.folder import RunFolder
from duobench.results.journal import Journal
from duobench.results.records import FirstAnswer, Key, Record
from duobench.results.report import write_report
from duobench.results.run import (
    RUN_SCHEMA,
    WHOLE,
    Resuming,
    Run,
    Shard,
    TimeLimits,
)
from duobench.results.scores import Results, summarize
from duobench.results.suite import Episode, Suite, TaskInfo
from duobench.world.looks.catalog import as_look
from duobench.world.robot.gripper import DEFAULT_GRIPPER

_RESUMING = Resuming()


def evaluate(  # noqa: PLR0913
    policy: str | PolicyChoice,
    suite: Suite,
    folder: RunFolder,
    *,
    videos: int = 0,
    video_look: str | None = None,
    limits: TimeLimits | None = None,
    workers: int = 1,
    observers: Sequence[Observer[Record]] = (),
    resuming: Resuming = _RESUMING,
    command: str = "",
    shard: Shard = WHOLE,
    cluster: Cluster | None = None,
) -> Results:
    """Play the episodes of a suite that have no record yet, and write the report.

    The policy makes its first chunk twice, with one seed: records and report say whether both
    were the same.

    Args:
        policy: `expert`, a baseline's name, `module:attribute`, or a choice that also says
            whether it plays in batches or at a server.
        suite: What to play, under every shift that it names.
        folder: Where everything is written; a folder that holds the same run is continued.
        videos: How many episodes of each task and shift, from the first on, have a video.
        video_look: Look of the table in them; None is that of the suite.
        limits: How long the policy may take.
        workers: Processes that play side by side. With 0 this process plays: fine for a debugger,
            but it cannot stop a policy that hangs or outlive one that ends its process.
        observers: Called about the progress, in this process.
        resuming: What is done with a run that is there.
        command: The command that starts it, for the report.
        shard: Which part of the episodes is played. All parts may be played into one folder, or
            into several that are copied into one. What finishes the run writes the report.
        cluster: The Ray cluster on which workers and policy are; None for this machine alone.

    Returns:
        What the records add up to: of the shard, under all shifts.

    Raises:
        EvaluationError: If the number of workers or videos is negative, episodes cannot be played
            (`MachineryError`, `UnplayedError`), or records are missing at the end.
        OtherRunError: If the folder holds another run.
        OutputError: If the folder cannot be written, or the shard is being written.
        FileError: If a record is broken.
        PolicyError: If the policy cannot be made, or does not fit the environment.
        DuoBenchError: If the environment cannot be made.
    """
    if video_look is not None:
        as_look(video_look)
    choice = PolicyChoice(name=policy) if isinstance(policy, str) else policy
    if videos < 0:
        raise EvaluationError(f"The number of videos is 0 or more, got {videos}.")
    job = Job(
        policy=choice,
        suite=suite,
        limits=limits or TimeLimits(),
        videos=videos,
        video_look=video_look,
    )
    executor = executor_for(job, workers, cluster)
    with folder.writer(shard) as journal, closing(executor):
        run = executor.prepare()
        if resuming.fresh:
            folder.clear(run, shard)
            journal.clear()
        elif folder.gives_way(run):
            folder.clear(run, shard, keeps_attempts=True)
        episodes = run.episodes(shard, videos)
        # Of a policy that gives no first chunk, nothing is written.
        ask = partial(_first_answer, executor, run.episodes())
        first_answer = ask() if episodes and not folder.has_records else None
        folder.begin(run, shard)
        journal.start(command, workers)
        finished = _finished(
            folder,
            run,
            shard,
            retry_broken=resuming.retry_broken,
        )
        records = {record.key: record for record in finished}
        missing = [each for each in episodes if run.key(each) not in records]
        if missing and first_answer is None:
            first_answer = ask()
        for observer in observers:
            observer.on_run_start(run, finished)
        results = executor.play(missing, _NotedAttempts(run, journal))
        if resuming.unplayed_count_as_failures:
            results = chain(results, executor.failures())
        for result in results:
            earlier = journal.earlier(result.record.key)
            record = replace(
                result.record,
                attempt=1 + len(earlier),
                earlier=earlier,
                first_answer=first_answer,
            )
            records[record.key] = record
            folder.write(record, result.video)
            journal.end(record, result.times)
            for observer in observers:
                observer.on_episode(record)
        given_up = {
            each: why
            for each, why in executor.unplayed.items()
            if run.key(each) not in records
        }
        there = _report(folder, shard)
        check_played(given_up, has_shifts=len(suite.shifts) > 1)
        _check_complete(folder, set(run.episode_keys(shard)), there)
    return summarize(suite.tasks, list(records.values()))


def _first_answer(
    executor: Executor, episodes: Sequence[Episode]
) -> FirstAnswer | None:
    """First chunk of the policy, at the first task that gives an observation; None if all fail."""
    for episode in episodes:
        with suppress(
            TaskFailedError
        ):  # which is told when the episode is to be played
            return executor.rehearse(episode)
    return None


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
) -> list[Record]:
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


def _check_complete(
    folder: RunFolder,
    ours: Set[Key],
    there: Sequence[Key],
) -> None:
    """Reject a folder in which records of a shard are missing that were played."""
    missing = ours - set(there)
    if missing:
        raise EvaluationError(
            f"{len(missing)} of {len(ours)} records are missing from {folder.path} although "
            "their episodes were played: they were removed. Run the evaluation again: it "
            "plays what is missing."
        )


MAX_EPISODES_PER_SUCCESS = 10
"""Episodes that are played for one that succeeds, on average, before a task is given up."""


def record(  # noqa: PLR0913
    policy: str,
    tasks: Sequence[TaskInfo],
    data: DataSet,
    *,
    episodes: int = 50,
    first: int = 0,
    split: str = TRAIN,
    instructions: str = FIXED,
    keep_failures: bool = False,
    after_success: float = AFTER_SUCCESS_S,
    limits: TimeLimits | None = None,
    workers: int = 1,
    gripper: str = DEFAULT_GRIPPER,
    observers: Sequence[Observer[Attempt]] = (),
    command: str = "",
) -> list[Attempt]:
    """Record episodes of a policy until a data set has enough of every task.

    Args:
        policy: `expert`, a baseline's name, or `module:attribute`.
        tasks: What to record.
        data: Where; a data set that holds the same recording is continued.
        episodes: How many successful episodes of each task.
        first: Index of the first episode of each task; a data set is continued from the same one.
        split: Layouts that the episodes begin with. Those of "eval" are what policies are evaluated
            on: what learns from them cannot be evaluated any more.
        instructions: What the policy is told; see `EnvConfig`.
        keep_failures: Keep every episode, and count it, whether it succeeds or not.
        after_success: Seconds that a recording goes on after success, rounded to control steps.
        limits: How long the policy may take.
        workers: Processes that play side by side; with 0 this process plays.
        gripper: Gripper on the arms; see `EnvConfig`.
        observers: Called about the progress, in this process.
        command: The command that starts the recording, for the list of attempts.

    Returns:
        Every episode that was played, by task and index.

    Raises:
        OtherRunError: If the data set holds another recording.
        OutputError: If it is in use or cannot be written.
        TooFewSuccessesError: If the policy hardly ever succeeds; what is finished is kept.
        UnplayedError: If an episode could not be played because a process died in it each time.
        PolicyError: If the policy cannot be made, or does not fit the environment.
        OptionError: If the seconds after success are negative or not finite.
    """
    plan = RecordingPlan(
        split=split,
        keep_failures=keep_failures,
        after_success=steps_after_success(after_success) / CONTROL_HZ,
        instructions=instructions,
    )
    job = Job(
        policy=PolicyChoice(name=policy),
        suite=Suite(
            tasks=tuple(tasks),
            episodes=episodes,
            first_episode=first,
            gripper=gripper,
        ),
        limits=limits or TimeLimits(),
        recording=plan,
    )
    executor = executor_for(job, workers)
    with locked(data.path), closing(executor):
        log = _Log(data, executor.prepare(), plan, command)
        return log.played_by(executor, observers)


_ADVICE = "Record into a folder of its own; data sets can be merged afterwards."


class _Log:
    """Log of what was played for a data set; begins a recording in it, or continues it."""

    def __init__(
        self, data: DataSet, run: Run, plan: RecordingPlan, command: str
    ) -> None:
        self._data = data
        self._run = run
        self._plan = plan
        self._command = command
        self._path = data.path / ATTEMPTS
        remove_temporary(data.path)
        begin_or_continue(
            data.path,
            data.path / RUN,
            run,
            RUN_SCHEMA,
            what="recording",
            foreign=f"{EPISODES}/*/*{SUFFIX}",
            advice=_ADVICE,
        )
        write(data.path / RUN, encode(run, RUN_SCHEMA))
        known = (
            read(self._path, Attempts, ATTEMPTS_SCHEMA)
            if self._path.exists()
            else Attempts()
        )
        # What is kept is what has a file: one may have been removed by hand, and one that was just
        # finished when everything was killed is not in the list.
        found = [
            *(each for each in known.attempts if not each.kept),
            *map(self._kept, data.episodes()),
        ]
        self._attempts = {(each.task, each.episode): each for each in found}

    def _kept(self, path: Path) -> Attempt:
        """The attempt that an episode of the data set comes from, or an `OtherRunError`."""
        task, index = path.parent.name, int(path.stem) if path.stem.isdecimal() else 0
        try:
            recording = Recording.read(path)
        except DataError as error:
            raise DataError(
                f"{error} Remove the file, and the same command records it again."
            ) from error
        info = recording.info
        outcome = info.outcome
        if info.after_success != self._plan.after_success:
            raise OtherRunError(
                f"{path} belongs to another recording; this one has seconds after success "
                f"{self._plan.after_success:g} instead of {info.after_success:g}. {_ADVICE}"
            )
        if (
            path.stem != f"{index:05d}"
            or not outcome
            or not self._plan.is_of(info, task, index)
        ):
            raise OtherRunError(
                f"{path} was not recorded here under this name: it was renamed, merged, recovered, "
                "or recorded with other options. Move it away."
            )
        return Attempt(
            task=task,
            episode=index,
            success=outcome.success and not outcome.cut,
            stage=outcome.stage,
            steps=recording.steps,
            kept=True,
            error=outcome.reason,
        )

    def played_by(
        self, executor: Executor, observers: Sequence[Observer[Attempt]]
    ) -> list[Attempt]:
        """Play episodes until there are enough; return all attempts by task and index."""
        for observer in observers:
            observer.on_run_start(self._run, list(self._attempts.values()))
        while missing := [
            Episode(task=task, index=index, split=self._plan.split)
            for task in self._run.suite.tasks
            for index in self._next(task)
        ]:
            for result in executor.play(missing):
                attempt = self._add(result)
                for observer in observers:
                    observer.on_episode(attempt)
            check_played(executor.unplayed)
        return sorted(self._attempts.values())

    def _next(self, task: TaskInfo) -> list[int]:
        """The episodes to play next: those that are enough if all of them succeed."""
        missing = list[int]()
        kept = 0
        suite = self._run.suite
        index, wanted = suite.first_episode, suite.episodes
        while kept < wanted:
            attempt = self._attempts.get((task.id, index))
            if attempt is None:
                missing.append(index)
            kept += attempt is None or attempt.kept
            index += 1
            played = index - suite.first_episode
            if played > MAX_EPISODES_PER_SUCCESS * wanted:
                raise TooFewSuccessesError(
                    f"Only {kept - len(missing)} of the first {played - len(missing)} episodes of "
                    f"{task.id} succeeded; {wanted} are wanted. What succeeded is kept."
                )
        return missing

    def _add(self, result: EpisodeResult) -> Attempt:
        record, recording = result.record, result.recording
        if recording is not None:
            self._data.add(record.task, f"{record.episode:05d}", recording)
        attempt = Attempt(
            task=record.task,
            episode=record.episode,
            success=record.success,
            stage=record.final_stage,
            steps=record.steps,
            kept=recording is not None,
            error=record.reason or None,
        )
        self._attempts[attempt.task, attempt.episode] = attempt
        played = Attempts(
            attempts=tuple(sorted(self._attempts.values())), command=self._command
        )
        write(self._path, encode(played, ATTEMPTS_SCHEMA))
        return attempt
