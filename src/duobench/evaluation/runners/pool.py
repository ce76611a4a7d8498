"""Pool of the processes that do a job: workers that simulate, and policies."""

import time
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing.connection import wait
from typing import Any, Protocol

import msgspec

from duobench.evaluation.episode import Job
from duobench.evaluation.runners.policy_process import Answering, MakePolicy
from duobench.evaluation.runners.process import (
    POLICY_BYTES,
    ProcessFailed,
    Stop,
    Transport,
    WorkerProcess,
)
from duobench.evaluation.runners.worker import PlayEpisode, Rehearse, Report
from duobench.policy.serving.address import PolicyAddress
from duobench.results.records import Record
from duobench.results.suite import Episode, TaskInfo

MAX_FAILED_STARTS = 3
SHUTDOWN_TIMEOUT_S = 10.0
"""Seconds that processes have to end before they are killed."""
_LOOK_S = 0.01
"""Seconds between looks whether they have ended."""
WORKER = "duobench.evaluation.runners.worker"
POLICY = "duobench.evaluation.runners.policy_process"


class Launcher(Protocol):
    """Launcher of processes, on this machine or elsewhere."""

    max_failed_starts: int
    """Failed starts in a row after which the run gives up."""

    def open(self) -> None:
        """Get ready to start processes."""

    def start_policy(self) -> Transport:
        """Start a process that makes a policy."""
        ...

    def start_worker(self, policy: Transport | None) -> Transport:
        """Start a worker, which waits for a job.

        Args:
            policy: The process of its policy, which is best near it.
        """
        ...

    def wait(self, processes: Sequence[Any], seconds: float) -> Sequence[Any]:
        """Wait for messages up to some seconds; return the processes that sent one."""
        ...

    def close(self) -> None:
        """Free what `open` got, after all processes have ended."""


class LocalLauncher(Launcher):
    """Launcher of processes on this machine."""

    max_failed_starts = MAX_FAILED_STARTS

    def start_policy(self) -> Transport:
        """Start a process that makes a policy."""
        return WorkerProcess(POLICY, Answering | ProcessFailed, most=POLICY_BYTES)

    def start_worker(self, policy: Transport | None) -> Transport:  # noqa: ARG002 - all are near
        """Start a worker, which waits for a job."""
        return WorkerProcess(WORKER, Report)

    def wait(self, processes: Sequence[Any], seconds: float) -> Sequence[Any]:
        """Wait for messages up to some seconds; return the processes that sent one."""
        return wait(processes, seconds)


class RunningPolicy:
    """A policy in a process of its own."""

    def __init__(self, process: Transport) -> None:
        self.process = process
        self.address: PolicyAddress | None = None

    @property
    def is_ready(self) -> bool:
        """Whether it accepts observations."""
        return self.address is not None


class Worker:
    """A worker, as the executor sees it.

    Args:
        process: Its process, which waits for a job.
        policy: The policy that acts for it; None if it makes the policy itself.
    """

    def __init__(self, process: Transport, policy: RunningPolicy | None) -> None:
        self.process = process
        self.policy = policy
        self.is_ready = False
        self.episode: Episode | None = None
        """Episode that it plays."""
        self.is_alone = True
        """Whether its policy has acted for no other worker since the episode began."""
        self.progress: Record | None = None
        """Record of the episode so far, once it has begun."""
        self.task: TaskInfo | None = None

    def begin(self, job: Job) -> None:
        """Let the worker make the policy, or connect to it."""
        if self.policy is not None:
            choice = replace(job.policy, address=self.policy.address)
            job = msgspec.structs.replace(job, policy=choice)
        self.process.send(job)

    def rehearse(self, episode: Episode) -> None:
        """Let the policy act on the first observation of an episode."""
        self.episode = episode
        self.process.send(Rehearse(episode=episode))

    def play(self, episode: Episode) -> None:
        """Let the worker play an episode."""
        self.episode = episode
        self.task = episode.task
        self.progress = None
        self.is_alone = True
        self.process.send(PlayEpisode(episode=episode))


class WorkerPool:
    """Workers and policies: one `BatchPolicy` for all workers, or one plain policy for each."""

    def __init__(self, job: Job, launcher: Launcher) -> None:
        self._job = job
        self._launcher = launcher
        self._policies: list[RunningPolicy] = []
        self.workers: list[Worker] = []
        self._is_shared: bool | None = None  # not known before the policy is made

    @property
    def members(self) -> list[Worker | RunningPolicy]:
        """Policies, then workers: the end of a policy is noticed before its workers report it."""
        return [*self._policies, *self.workers]

    @property
    def playing(self) -> list[Worker]:
        """The workers that play an episode."""
        return [worker for worker in self.workers if worker.episode is not None]

    def note_company(self) -> None:
        """Mark the playing workers whose policy acts for another playing worker too."""
        playing = self.playing
        for worker in playing:
            mates = [each for each in playing if each.policy is worker.policy]
            worker.is_alone = worker.is_alone and mates == [worker]

    def start(self, wanted: int) -> None:
        """Start processes for a number of workers; those of policies come first."""
        if not self._job.policy.kind.has_process or (
            self._is_shared and self._policies
        ):
            shared = self._policies[0] if self._policies else None
            for _ in range(wanted - len(self.workers)):
                self._start_worker(shared)
            return
        for policy in self._policies:  # its worker may have died
            has_worker = any(worker.policy is policy for worker in self.workers)
            if not has_worker and len(self.workers) < wanted:
                self._start_worker(policy)
        # Whether all workers share one policy is known once it is made.
        most = wanted if self._is_shared is False else 1
        for _ in range(most - len(self.workers)):
            self._start_worker(self._start_policy())

    def note_address(self, policy: RunningPolicy, address: PolicyAddress) -> None:
        """Note that a policy can be reached, and let its workers begin."""
        policy.address = address
        self._is_shared = address.batching is not None
        for worker in self.workers:
            if worker.policy is policy:
                worker.begin(self._job)

    def remove(self, member: Worker | RunningPolicy) -> list[Worker]:
        """End a process, and with a policy also its workers; return the ended workers."""
        if isinstance(member, Worker):
            removed = [member]
        else:
            self._policies.remove(member)
            member.process.kill()
            removed = [worker for worker in self.workers if worker.policy is member]
        for worker in removed:
            self.workers.remove(worker)
            worker.process.kill()
        return removed

    def close(self) -> None:
        """Stop all processes, then kill those left and their children."""
        idle = [
            worker
            for worker in self.workers
            if worker.is_ready and worker.episode is None
        ]
        for worker in self.workers:
            worker.process.send(Stop())
        _wait_for(idle)
        for policy in self._policies:
            policy.process.send(Stop())
        _wait_for([policy for policy in self._policies if policy.is_ready and idle])
        for member in self.members:
            member.process.kill()
        self.workers.clear()
        self._policies.clear()

    def wait(self, seconds: float) -> list[Worker | RunningPolicy]:
        """Wait for messages up to some seconds; return the members that sent one."""
        said = self._launcher.wait([member.process for member in self.members], seconds)
        return [member for member in self.members if member.process in said]

    def _start_policy(self) -> RunningPolicy:
        job = self._job
        policy = RunningPolicy(self._launcher.start_policy())
        self._policies.append(policy)
        policy.process.send(
            MakePolicy(
                name=job.policy.name, batching=job.policy.batching, limits=job.limits
            )
        )
        return policy

    def _start_worker(self, policy: RunningPolicy | None) -> None:
        """Start a worker, which begins once its policy can be reached."""
        worker = Worker(self._launcher.start_worker(policy and policy.process), policy)
        self.workers.append(worker)
        if policy is None or policy.is_ready:
            worker.begin(self._job)


def _wait_for(members: Sequence[Worker | RunningPolicy]) -> None:
    deadline = time.monotonic() + SHUTDOWN_TIMEOUT_S
    while time.monotonic() < deadline and not all(
        each.process.death() for each in members
    ):
        time.sleep(_LOOK_S)
