"""Worker: a process with a simulator, which plays episodes, and its messages."""

from functools import partial

import msgspec

from duobench.core.errors import MachineryError, escaped
from duobench.evaluation.clock import EpisodeClock
from duobench.evaluation.episode import EpisodeResult, EpisodeRunner, Job
from duobench.evaluation.policies import find_source
from duobench.evaluation.runners.process import (
    Parent,
    ProcessFailed,
    Requests,
    Stop,
    run_child,
)
from duobench.evaluation.runners.schedule import end_of
from duobench.results.attempts import MACHINERY
from duobench.results.records import FirstAnswer, Record
from duobench.results.run import Run
from duobench.results.suite import Episode


class PlayEpisode(msgspec.Struct, tag=True, frozen=True):
    """Request to a worker: play an episode."""

    episode: Episode


class Rehearse(msgspec.Struct, tag=True, frozen=True):
    """Request to a worker: let the policy act twice on the first observation of an episode."""

    episode: Episode


class Ready(msgspec.Struct, tag=True, frozen=True):
    """Report of a worker: the policy is made."""

    run: Run
    versions: dict[str, str | None]
    """Versions of everything that a result may depend on."""


class Rehearsed(msgspec.Struct, tag=True, frozen=True):
    """Report of a worker: the policy has acted."""

    answer: FirstAnswer


class EpisodeProgress(msgspec.Struct, tag=True, frozen=True):
    """Report of a worker: the episode has begun, or reached a new stage."""

    record: Record


class EpisodeError(msgspec.Struct, tag=True, frozen=True):
    """Report of a worker: the episode failed, through no known fault of the policy."""

    fault: str
    how: str = MACHINERY
    """End of the attempt, one of `duobench.results.attempts.ENDS`."""


Request = Job | PlayEpisode | Rehearse | Stop
"""Requests to a worker; the first is a job, with which it makes the policy."""
Report = (
    Ready | Rehearsed | EpisodeProgress | EpisodeResult | EpisodeError | ProcessFailed
)


def main(connection: int, clock: int) -> None:
    """Play episodes until asked to stop; see `WorkerProcess`."""
    run_child(connection, Request, partial(_play, clock=EpisodeClock(clock)))


def _play(
    job: Job,
    parent: Parent,
    requests: Requests,
    *,
    clock: EpisodeClock,
) -> None:
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
