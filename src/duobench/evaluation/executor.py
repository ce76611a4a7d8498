"""Where episodes are played: in this process, or in workers that may hang or die without harm."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import wait
from typing import Protocol

import msgspec

from duobench import errors
from duobench.errors import EvaluationError, MachineryError, MessageError, RenderingError
from duobench.evaluation.episode import EpisodeResult, EpisodeRunner, Job
from duobench.evaluation.messages import (
    EpisodeError,
    Play,
    Progress,
    Ready,
    Refused,
    Report,
    StartHost,
    Stop,
)
from duobench.evaluation.policies import find_source
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.schedule import Schedule
from duobench.evaluation.worker import Worker
from duobench.policy.registry import PolicyKind
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.sim import rendering

_log = logging.getLogger(__name__)

MAX_FAILED_STARTS = 3
"""Workers that die one after the other while they start, until the run gives up."""
SHUTDOWN_TIMEOUT_S = 10.0
"""How long workers may take to free everything before they are killed, in seconds."""
DEATH_SEEN_S = 1.0
"""How long after a lost connection the end of a worker may be seen, in seconds."""
HOST_DEATH_S = 0.5
"""How long after a lost connection the end of the policy's process may be seen, in seconds."""
HANG_S = 1.0
"""How long a hosted policy may be late, in seconds: until those whom it keeps waiting know it, and
before those who called later wait in vain."""
TICK_S = 0.1
"""How often deaths and time limits are looked after, in seconds."""
GRACE_S = 60.0
"""How long an episode may be over its time limit without its policy being busy, in seconds."""
_MAY_SEE = (PolicyKind.LEROBOT, PolicyKind.MODULE, PolicyKind.SERVED)
"""Kinds of policies that may ask for images."""


class Executor(Protocol):
    """Something that plays episodes, in whatever processes, and writes nothing."""

    def prepare(self) -> Run:
        """Make the policy, and say what is played by what.

        Raises:
            DuoBenchError: If the policy cannot be made.
        """
        ...

    def play(self, episodes: Sequence[Episode]) -> Iterator[EpisodeResult]:
        """Play episodes, each exactly once, after `prepare`.

        Args:
            episodes: What to play, in any order.

        Yields:
            Their results, in the order in which they are finished.

        Raises:
            MachineryError: If one of them cannot be played.
            DuoBenchError: If the policy does not fit, or an environment cannot be made.
        """
        ...

    def close(self) -> None:
        """End every process, and whatever the policy has started in it."""
        ...


class LocalExecutor:
    """Plays in this process: for debugging, notebooks and tests.

    It cannot outlive a policy that ends its process, it cannot stop one that hangs (an answer
    that comes too late fails the episode once it comes), and it leaves alone what a policy has
    started. `ProcessExecutor` does all of that, with one worker too.
    """

    def __init__(self, job: Job) -> None:
        """Remember what to play, and how."""
        self._job = job
        self._schedule = Schedule()
        self._runner: EpisodeRunner | None = None

    def prepare(self) -> Run:
        """Make the policy, and say what is played by what."""
        job = self._job
        self._runner = EpisodeRunner(find_source(job.policy, job.suite.tasks, job.limits), job)
        return self._runner.run

    def play(self, episodes: Sequence[Episode]) -> Iterator[EpisodeResult]:
        """Play episodes in their order."""
        if self._runner is None:
            raise AssertionError("An executor is prepared before it plays.")
        for episode in episodes:
            result = None
            while result is None:
                try:
                    result = self._runner.play(episode)
                except MachineryError as fault:
                    self._schedule.note_fault(episode, str(fault))
            yield result

    def close(self) -> None:
        """Free environment and policy."""
        if self._runner is not None:
            self._runner.close()
            self._runner = None


class ProcessExecutor:
    """Plays in processes of their own, side by side; one that hangs or dies is replaced.

    Workers are new processes that import only what they need: a script that calls this needs no
    `if __name__ == "__main__":` guard.
    """

    def __init__(self, job: Job, workers: int) -> None:
        """Remember what to play, by at most so many processes, which are started when needed."""
        self._job = job
        self._schedule = Schedule()
        self._for_workers = self._job
        self._most = workers
        self._host: Worker | None = None
        self._is_hosted = False
        self._workers: list[Worker] = []
        self._failed_starts = 0
        self._ready: Ready | None = None

    def prepare(self) -> Run:
        """Start a first worker, and say what is played by what."""
        while self._ready is None:
            if not self._workers:
                self._workers.append(Worker(self._for_workers))
            for _ in self._poll():
                pass
        return self._ready.run

    def play(self, episodes: Sequence[Episode]) -> Iterator[EpisodeResult]:
        """Play episodes; those of a task go to as few workers as keeps all of them busy."""
        self._schedule.add(episodes)
        while self._schedule.left or any(worker.episode for worker in self._workers):
            self._dispatch()
            yield from self._poll()

    def close(self) -> None:
        """Let workers free what they hold, then end them and all that they have started."""
        if self._host is not None:
            self._workers.append(self._host)
        for worker in self._workers:
            worker.send(Stop())
        deadline = time.monotonic() + SHUTDOWN_TIMEOUT_S
        idle = [worker for worker in self._workers if worker.is_ready and worker.episode is None]
        while time.monotonic() < deadline and not all(worker.death() for worker in idle):
            time.sleep(TICK_S / 10)
        for worker in self._workers:
            worker.kill()
        self._workers.clear()

    def _dispatch(self) -> None:
        """Give waiting episodes to idle workers, and start more workers for the rest."""
        for worker in self._workers:
            if worker.is_ready and worker.episode is None and self._schedule.left:
                worker.episode = self._schedule.next(worker.task)
                worker.task, worker.progress = worker.episode.task, None
                worker.send(Play(episode=worker.episode))
        starting = sum(not worker.is_ready for worker in self._workers)
        wanted = min(self._schedule.left - starting, self._most - len(self._workers))
        if self._is_hosted and self._host is None:  # the next one is to be the host
            wanted = 1 - len(self._workers)
        self._workers.extend(Worker(self._for_workers) for _ in range(wanted))

    def _poll(self) -> Iterator[EpisodeResult]:
        """Wait for reports, a moment at most, and act on them."""
        self._check_host()
        readable = wait([worker.channel.socket for worker in self._workers], TICK_S)
        for worker in list(self._workers):
            reports, fault = [], None
            try:
                if worker.channel.socket in readable:
                    reports = worker.channel.receive()
                else:
                    fault = worker.death()
            except EOFError:
                fault = worker.death_within(DEATH_SEEN_S) or "its process closed the connection."
            except MessageError as error:
                fault = f"its result cannot be read ({error})."
            for report in reports:
                if worker in self._workers:
                    yield from self._receive(worker, report)
            if worker not in self._workers:
                continue
            if fault is not None:
                self._replace(worker, fault)
            else:
                yield from self._check_time(worker)

    def _receive(self, worker: Worker, report: Report) -> Iterator[EpisodeResult]:
        """Act on a report."""
        match report:
            case Ready():
                if self._ready not in (None, report):
                    raise EvaluationError("The policy has changed while the run was going on.")
                self._ready = report
                self._failed_starts = 0
                worker.is_ready = True
            case StartHost(server=server):
                self._workers.remove(worker)
                self._host, self._is_hosted = worker, True
                worker.is_ready = True
                served = replace(self._job.policy, server=server)
                self._for_workers = msgspec.structs.replace(self._job, policy=served)
            case Progress(record=record):
                if worker.episode and self._run.objection(record, worker.episode) is None:
                    worker.progress = record
            case EpisodeResult():
                yield from self._accept(worker, report)
            case EpisodeError(fault=fault):
                if self._host and (death := self._host.death_within(HOST_DEATH_S)):
                    fault = f"of the policy, {death}"
                self._replay(worker, fault)
            case Refused(error=name, message=message):
                raise getattr(errors, name, EvaluationError).from_message(message)

    def _accept(self, worker: Worker, result: EpisodeResult) -> Iterator[EpisodeResult]:
        """Pass on what was asked for, and drop anything else: it comes from where policies are."""
        if worker.episode is None:
            _log.warning("A result that nobody asked for was dropped.")
            return
        objection = result.objection(worker.episode, self._run, self._job.recording)
        if objection is None:
            worker.episode = None
            yield result
        else:
            self._replace(worker, f"its result was dropped: {objection}")

    @property
    def _run(self) -> Run:
        if self._ready is None:
            raise AssertionError("An executor is prepared before it plays.")
        return self._ready.run

    def _replay(self, worker: Worker, fault: str) -> None:
        """Have the episode of a worker played again."""
        if worker.episode is not None:
            self._schedule.replay(worker.episode, fault)
            worker.episode = None

    def _replace(self, worker: Worker, fault: str) -> None:
        """Let go of a worker that is of no more use, and have its episode played again."""
        self._workers.remove(worker)
        worker.kill()
        if not worker.is_ready:
            self._note_failed_start(fault)
        self._replay(worker, fault)

    def _note_failed_start(self, fault: str) -> None:
        """Note that a process was of no use; too many in a row end the run."""
        self._failed_starts += 1
        if self._failed_starts == MAX_FAILED_STARTS:
            raise MachineryError(
                f"{MAX_FAILED_STARTS} workers in a row failed while they were starting, the "
                f"last one like this: {fault}"
            )

    def _check_host(self) -> None:
        """Replace the process of a policy that has died or hangs; what was played is played again.

        Whoever waited too long for it has been told by then, which fails an episode.
        """
        if (host := self._host) is None:
            return
        is_late = host.clock.answer_s() > self._job.limits.served_s + HANG_S
        fault = host.death() or ("the policy does not come back." if is_late else None)
        if fault is None:
            return
        self._host = None
        self._for_workers = self._job
        host.kill()
        for worker in self._workers:
            worker.kill()
            self._replay(worker, f"of the policy, {fault}")
        self._workers.clear()
        self._note_failed_start(fault)

    def _check_time(self, worker: Worker) -> Iterator[EpisodeResult]:
        """Fail the episode of a policy that takes too long; its worker cannot be used again."""
        if worker.episode is None or self._ready is None:
            return
        if late := worker.clock.late(self._job.limits):
            self._workers.remove(worker)
            worker.kill()
            record = worker.progress or EpisodeRecorder(worker.episode).record(
                self._ready.run, self._ready.versions
            )
            # The policy's process can write into the clock, and nonsense must not end the run.
            steps = min(max(worker.clock.steps, record.steps), record.horizon)
            yield EpisodeResult(record=record.broken(late, steps))
        elif worker.clock.episode_s() > self._job.limits.episode_s + GRACE_S:
            self._replace(worker, "the simulation did not come back within the time limit.")


def executor_for(job: Job, workers: int) -> Executor:
    """What does a job.

    Args:
        job: What to play.
        workers: Processes that play side by side; with 0 this process plays.

    Raises:
        EvaluationError: If the number of workers is negative.
        RenderingError: If there are to be videos, and nothing renders.
    """
    if workers < 0:
        raise EvaluationError(
            f"The number of workers is 1 or more, or 0 for this process alone; got {workers}."
        )
    if workers == 0:
        return LocalExecutor(job)
    # How to render is chosen before there are workers, so that not each of them finds out for
    # itself. Only its worker knows whether a policy sees images: it is the one to complain.
    if job.videos:
        rendering.choose(processes=workers)
    elif job.policy.name.kind in _MAY_SEE and workers > 1:
        with suppress(RenderingError):
            rendering.choose(processes=workers)
    return ProcessExecutor(job, workers)
