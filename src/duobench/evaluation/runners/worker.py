"""A worker: a process with a simulator, which plays episodes; and what it and its parent say."""

from functools import partial

import msgspec

from duobench.core.errors import MachineryError, escaped
from duobench.evaluation.clock import EpisodeClock
from duobench.evaluation.episode import EpisodeResult, EpisodeRunner, Job
from duobench.evaluation.policies import find_source
from duobench.evaluation.runners.process import Parent, ProcessFailed, Requests, Stop, run_child
from duobench.evaluation.runners.schedule import end_of
from duobench.results.attempts import MACHINERY
from duobench.results.records import EpisodeRecord, FirstAnswer
from duobench.results.run import Run
from duobench.results.suite import Episode


class PlayEpisode(msgspec.Struct, tag=True, frozen=True):
    """To a worker: play an episode."""

    episode: Episode


class Rehearse(msgspec.Struct, tag=True, frozen=True):
    """To a worker: have the policy answer the first observation of an episode twice."""

    episode: Episode


class Ready(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the policy is made."""

    run: Run
    versions: dict[str, str | None]
    """Versions of everything that a result may depend on."""


class Rehearsed(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the policy has answered."""

    answer: FirstAnswer


class EpisodeProgress(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the episode has begun, reached a new stage, or is played on."""

    record: EpisodeRecord


class EpisodeError(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the episode is unplayed, through no fault of the policy that is known yet."""

    fault: str
    how: str = MACHINERY
    """How the attempt ended, one of `duobench.results.attempts.ENDS`."""


Request = Job | PlayEpisode | Rehearse | Stop
"""To a worker; a job comes first, which has it make the policy."""
Report = Ready | Rehearsed | EpisodeProgress | EpisodeResult | EpisodeError | ProcessFailed


def main(connection: int, clock: int) -> None:
    """Play episodes until asked to stop; see `WorkerProcess`."""
    run_child(connection, Request, partial(_play, clock=EpisodeClock(clock)))


def _play(job: Job, parent: Parent, requests: Requests, *, clock: EpisodeClock) -> None:
    """Make the policy, then play one episode after the other."""
    runner = EpisodeRunner(
        find_source(job.policy, job.suite.tasks, job.limits),
        job,
        clock,
        lambda record: parent.report(EpisodeProgress(record=record)),
        is_interruptible=False,
    )
    parent.report(Ready(run=runner.run, versions=runner.versions))
    while not isinstance(request := requests.get(), Stop):
        try:
            if isinstance(request, Rehearse):
                report = Rehearsed(runner.rehearse(request.episode))
            else:
                report = runner.play(request.episode)
        except MachineryError as fault:
            report = EpisodeError(fault=escaped(str(fault)), how=end_of(fault))
        parent.report(report)
    runner.close()
