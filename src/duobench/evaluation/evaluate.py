"""Running an evaluation: what is missing in a folder is played, then everything is reported.

Whatever plays, this process alone writes.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, suppress
from typing import Protocol

from duobench.errors import EvaluationError, RenderingError
from duobench.evaluation.choice import PolicyChoice
from duobench.evaluation.episode import Job, RecordingPlan
from duobench.evaluation.executor import Executor, LocalExecutor, ProcessExecutor
from duobench.evaluation.folder import RunFolder
from duobench.evaluation.limits import TimeLimits
from duobench.evaluation.metrics import Results
from duobench.evaluation.records import EpisodeRecord
from duobench.evaluation.report import write_report
from duobench.evaluation.suite import Run, Suite
from duobench.files import locked
from duobench.sim import rendering
from duobench.versions import package_versions


class Observer(Protocol):
    """Something that shows how far a run is."""

    def on_run_start(self, run: Run, finished: Sequence[EpisodeRecord]) -> None:
        """The run begins, or goes on with some episodes already finished."""
        ...

    def on_record(self, record: EpisodeRecord) -> None:
        """One more episode is finished, and its record written."""
        ...


def evaluate(
    policy: str | PolicyChoice,
    suite: Suite,
    folder: RunFolder,
    *,
    videos: int = 0,
    limits: TimeLimits | None = None,
    workers: int = 1,
    observers: Sequence[Observer] = (),
    retry_broken: bool = False,
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
            but it cannot stop a policy that hangs or outlive one that crashes.
        observers: Called about the progress, in this process.
        retry_broken: Also play the episodes again whose records hold an error.

    Returns:
        What all records of the run add up to.

    Raises:
        EvaluationError: If the number of workers is negative, episodes cannot be played
            (`MachineryError`), or records are missing at the end.
        OtherRunError: If the folder holds another run.
        OutputError: If the folder cannot be written, or is in use.
        FileError: If a record is broken.
        PolicyError: If the policy cannot be made, or does not fit the environment.
        DuoBenchError: If the environment cannot be made.
    """
    limits = limits or TimeLimits()
    executor = executor_for(policy, suite, limits, videos, workers)
    with locked(folder.path), closing(executor):
        setup = executor.prepare()
        run = Run(
            policy=setup.policy,
            suite=suite,
            videos=videos,
            limits=limits,
            metadata=setup.metadata,
            config=setup.config,
            versions=package_versions(),
            batching=setup.batching,
        )
        folder.begin(run)
        finished = folder.read_records(run)
        if retry_broken:
            for record in finished:
                if record.error is not None:
                    folder.discard(record)
            finished = [record for record in finished if record.error is None]
        for observer in observers:
            observer.on_run_start(run, finished)
        done = {(record.task, record.episode) for record in finished}
        missing = [each for each in run.episodes() if (each.task.id, each.index) not in done]
        for result in executor.play(missing):
            folder.write(result.record, result.video)
            folder.note_timing(result.record, result.seconds)
            for observer in observers:
                observer.on_record(result.record)
        results = write_report(folder)
        if results.overall.episodes < suite.size:
            raise EvaluationError(
                f"{suite.size - results.overall.episodes} of {suite.size} records are missing from "
                f"{folder.path} although their episodes were played: somebody has removed them. "
                "Run the evaluation again: it plays what is missing."
            )
        return results


def executor_for(
    policy: str | PolicyChoice,
    suite: Suite,
    limits: TimeLimits,
    videos: int,
    workers: int,
    recording: RecordingPlan | None = None,
) -> Executor:
    """What plays a suite."""
    if workers < 0:
        raise EvaluationError(
            f"The number of workers is 1 or more, or 0 for this process alone; got {workers}."
        )
    choice = PolicyChoice(name=policy) if isinstance(policy, str) else policy
    choice.check()
    job = Job(policy=choice, tasks=suite.tasks, limits=limits, look=suite.look, recording=recording)
    if workers == 0:
        return LocalExecutor(job)
    # How to render is chosen before there are workers, so that not each of them finds out for
    # itself. Only its worker knows whether a policy sees images: it is the one to complain.
    if videos:
        rendering.choose(processes=workers)
    elif (":" in choice.name or choice.server) and workers > 1:
        with suppress(RenderingError):
            rendering.choose(processes=workers)
    return ProcessExecutor(job, workers)
