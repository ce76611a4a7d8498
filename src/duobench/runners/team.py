"""The processes that do a job: simulators in workers, and policies beside them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from multiprocessing.connection import wait

from duobench.evaluation.episode import Job
from duobench.evaluation.policies import PolicyAddress
from duobench.runners.messages import Stop
from duobench.runners.policy_process import (
    PolicyProcess,
    StopAnswering,
)
from duobench.runners.worker import Worker

SHUTDOWN_TIMEOUT_S = 10.0
"""How long processes may take to free everything before they are killed, in seconds."""
_LOOK_S = 0.01
"""How often is looked whether they have ended, in seconds."""


class Team:
    """Workers and policies: a `BatchPolicy` for all workers, a plain one beside each."""

    def __init__(self, job: Job) -> None:
        """Begin without a process."""
        self._job = job
        self._policies: list[PolicyProcess] = []
        self.workers: list[Worker] = []
        """All workers, in the order in which they were started."""
        self._is_shared: bool | None = None  # not known before the policy is made

    @property
    def children(self) -> list[Worker | PolicyProcess]:
        """All processes, policies first: what becomes of one is known before its workers tell."""
        return [*self._policies, *self.workers]

    @property
    def playing(self) -> list[Worker]:
        """The workers that play an episode."""
        return [worker for worker in self.workers if worker.episode is not None]

    def start(self, wanted: int) -> None:
        """Start processes until so many workers are there, or will be."""
        if not self._job.policy.has_process:
            for _ in range(wanted - len(self.workers)):
                self._start_worker(None)
            return
        if self._is_shared and self._policies:
            for _ in range(wanted - len(self.workers)):
                self._start_worker(self._policies[0])
            return
        for policy in self._policies:  # of workers that died
            has_worker = any(worker.policy is policy for worker in self.workers)
            if not has_worker and len(self.workers) < wanted:
                self._start_worker(policy)
        # Whether all workers share one policy is known once it is made.
        most = wanted if self._is_shared is False else 1
        for _ in range(most - len(self.workers)):
            self._policies.append(self._new_policy())
            self._start_worker(self._policies[-1])

    def note_address(self, policy: PolicyProcess, address: PolicyAddress) -> None:
        """A policy answers, and its workers may begin."""
        policy.address, policy.is_ready = address, True
        self._is_shared = address.batching is not None
        for worker in self.workers:
            if worker.policy is policy:
                worker.begin(self._job)

    def remove(self, child: Worker | PolicyProcess) -> list[Worker]:
        """End a process, and with a policy the workers that ask it; the workers that were ended."""
        if isinstance(child, Worker):
            removed = [child]
        else:
            self._policies.remove(child)
            child.kill()
            removed = [worker for worker in self.workers if worker.policy is child]
        for worker in removed:
            self.workers.remove(worker)
            worker.kill()
        return removed

    def close(self) -> None:
        """Let all processes free what they hold, then end them and all that they have started."""
        idle = [worker for worker in self.workers if worker.is_ready and worker.episode is None]
        for worker in self.workers:
            worker.send(Stop())
        _wait_for(idle)
        for policy in self._policies:
            policy.send(StopAnswering())
        _wait_for([policy for policy in self._policies if policy.is_ready and idle])
        for child in self.children:
            child.kill()
        self.workers.clear()
        self._policies.clear()

    def wait(self, seconds: float) -> Sequence[Worker | PolicyProcess]:
        """Wait until a process has said something, or the time is over; those that have."""
        sockets = {child.channel.socket: child for child in self.children}
        return [sockets[each] for each in wait(sockets, seconds)]  # pyright: ignore[reportArgumentType]

    def _new_policy(self) -> PolicyProcess:
        """Start a process that makes the policy."""
        choice = self._job.policy
        return PolicyProcess(choice.name, choice.batching, self._job.limits)

    def _new_worker(self, policy: PolicyProcess | None) -> Worker:
        """Start a worker, which waits for the job."""
        return Worker(policy)

    def _start_worker(self, policy: PolicyProcess | None) -> None:
        """Start a worker, which begins once its policy answers."""
        worker = self._new_worker(policy)
        self.workers.append(worker)
        if policy is None or policy.is_ready:
            worker.begin(self._job)


def _wait_for(children: Sequence[Worker | PolicyProcess]) -> None:
    deadline = time.monotonic() + SHUTDOWN_TIMEOUT_S
    while time.monotonic() < deadline and not all(child.death() for child in children):
        time.sleep(_LOOK_S)
