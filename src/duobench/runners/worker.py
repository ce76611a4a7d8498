"""A worker: a process with a simulator, which plays episodes."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from duobench.errors import MachineryError, escaped
from duobench.evaluation.clock import EpisodeClock
from duobench.evaluation.episode import EpisodeRunner, Job
from duobench.evaluation.policies import find_source
from duobench.results.records import EpisodeRecord
from duobench.results.suite import Episode, TaskInfo
from duobench.runners.child import Child, Parent, Requests, run_child
from duobench.runners.messages import (
    EpisodeError,
    Play,
    Progress,
    Ready,
    Rehearse,
    Rehearsed,
    Report,
    Request,
    Stop,
)
from duobench.runners.policy_process import PolicyProcess


class Worker(Child[Report]):
    """A worker as its parent sees it."""

    module = __name__

    def __init__(self, policy: PolicyProcess | None = None) -> None:
        """Start the process, which waits for a job.

        Args:
            policy: The process of the policy; None if the worker has the policy itself.

        Raises:
            MachineryError: The process cannot be started.
        """
        super().__init__(Report)
        self.policy = policy
        """The process of its policy."""
        self.episode: Episode | None = None
        """What it is playing."""
        self.progress: EpisodeRecord | None = None
        """The record of that so far, once it has begun."""
        self.task: TaskInfo | None = None
        """The task whose environment it has."""

    def begin(self, job: Job) -> None:
        """Have it make the policy, or connect to it."""
        if self.policy is not None:
            choice = replace(job.policy, address=self.policy.address)
            job = msgspec.structs.replace(job, policy=choice)
        self.send(job)

    def rehearse(self, episode: Episode) -> None:
        """Have its policy answer the first observation of an episode."""
        self.episode = episode
        self.send(Rehearse(episode=episode))

    def play(self, episode: Episode) -> None:
        """Have it play an episode."""
        self.episode, self.task, self.progress = episode, episode.task, None
        self.send(Play(episode=episode))


def main(connection: int, clock: int) -> None:
    """Play episodes until asked to stop.

    Args:
        connection: File descriptor of the socket to the parent.
        clock: File descriptor of the clock.
    """
    run_child(
        connection, Request, lambda parent, requests: _play(parent, requests, EpisodeClock(clock))
    )


def _play(parent: Parent, requests: Requests, clock: EpisodeClock) -> None:
    """Make the policy, then play one episode after the other."""
    job = requests.get()
    if not isinstance(job, Job):
        return
    source = find_source(job.policy, job.suite.tasks, job.limits)
    runner = EpisodeRunner(
        source,
        job,
        clock,
        lambda record: parent.report(Progress(record=record)),
        is_interruptible=False,
    )
    parent.report(Ready(run=runner.run, versions=runner.versions))
    while not isinstance(request := requests.get(), Stop):
        try:
            if isinstance(request, Rehearse):
                runner.rehearse(request.episode)
                report = Rehearsed()
            else:
                report = runner.play(request.episode)
        except MachineryError as fault:
            report = EpisodeError(fault=escaped(str(fault)))
        parent.report(report)
    runner.close()
