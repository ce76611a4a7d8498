"""Playing in processes that may hang or die without harm, simulators apart from policies."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from multiprocessing.connection import wait

import msgspec

from duobench import errors
from duobench.errors import (
    EvaluationError,
    MachineryError,
    MessageError,
    PolicyError,
    PolicyTimeoutError,
    UnplayedError,
)
from duobench.evaluation.episode import EpisodeResult, Job
from duobench.evaluation.processes.child import Refused
from duobench.evaluation.processes.messages import (
    EpisodeError,
    Progress,
    Ready,
    Rehearsed,
    Report,
    Stop,
)
from duobench.evaluation.processes.policy_process import Answering, PolicyProcess, StopAnswering
from duobench.evaluation.processes.schedule import Schedule
from duobench.evaluation.processes.worker import Worker
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Episode

_log = logging.getLogger(__name__)

MAX_FAILED_STARTS = 3
"""Processes that die one after the other while they start, until the run gives up."""
SHUTDOWN_TIMEOUT_S = 10.0
"""How long processes may take to free everything before they are killed, in seconds."""
DEATH_SEEN_S = 1.0
"""How long after a lost connection the end of a process may be seen, in seconds."""
HANG_S = 1.0
"""How long a policy's process may be late, in seconds, before it is ended: one that comes back
until then says itself that it was too slow."""
TICK_S = 0.1
"""How often deaths and time limits are looked after, in seconds."""
GRACE_S = 60.0
"""How long an episode may be over its time limit without its policy being busy, in seconds."""


class ProcessExecutor:
    """Plays in processes of their own, side by side; one that hangs or dies is replaced.

    A scripted policy plays in its worker. Any other has a process without a simulator: a
    `BatchPolicy` one for all workers, a plain policy one beside each.

    Workers are new processes that import only what they need: a script that calls this needs no
    `if __name__ == "__main__":` guard.
    """

    def __init__(self, job: Job, workers: int) -> None:
        """Remember what to play, by at most so many workers, which are started when needed."""
        self._job = job
        self._schedule = Schedule()
        self._most = workers
        self._policies: list[PolicyProcess] = []
        self._workers: list[Worker] = []
        self._is_shared: bool | None = None  # not known before the policy is made
        self._failed_starts = 0
        self._ready: Ready | None = None
        self._rehearsing: Worker | None = None

    @property
    def unplayed(self) -> dict[Episode, str]:
        """Episodes that could not be played, and why, in words."""
        return self._schedule.set_aside

    def prepare(self) -> Run:
        """Start a first worker, and say what is played by what."""
        while self._ready is None:
            self._start(1)
            for _ in self._poll():
                pass
        return self._ready.run

    def rehearse(self, episode: Episode) -> None:
        """Have the policy answer a first observation."""
        if self._job.policy.is_scripted:
            return
        (self._rehearsing,) = self._workers
        self._rehearsing.rehearse(episode)
        while self._rehearsing is not None:
            for _ in self._poll():
                pass

    def play(self, episodes: Sequence[Episode]) -> Iterator[EpisodeResult]:
        """Play episodes; those of a task go to as few workers as keeps all of them busy."""
        self._schedule.add(episodes)
        while self._schedule.left or self._playing:
            self._dispatch()
            yield from self._poll()

    def failures(self) -> Iterator[EpisodeResult]:
        """What is unplayed, as episodes that failed with an error."""
        for episode, why in self.unplayed.items():
            record = self._unknown(episode)
            yield EpisodeResult(record=record.broken(UnplayedError(f"It was not played: {why}"), 0))

    def close(self) -> None:
        """Let processes free what they hold, then end them and all that they have started."""
        for worker in self._workers:
            worker.send(Stop())
        idle = [worker for worker in self._workers if worker.is_ready and worker.episode is None]
        self._wait_for(idle)
        for process in self._policies:
            process.send(StopAnswering())
        self._wait_for([process for process in self._policies if process.is_ready and idle])
        for child in (*self._workers, *self._policies):
            child.kill()
        self._workers.clear()
        self._policies.clear()

    @staticmethod
    def _wait_for(children: Sequence[Worker | PolicyProcess]) -> None:
        deadline = time.monotonic() + SHUTDOWN_TIMEOUT_S
        while time.monotonic() < deadline and not all(child.death() for child in children):
            time.sleep(TICK_S / 10)

    @property
    def _playing(self) -> list[Worker]:
        return [worker for worker in self._workers if worker.episode is not None]

    @property
    def _run(self) -> Run:
        if self._ready is None:
            raise AssertionError("An executor is prepared before it plays.")
        return self._ready.run

    # --- starting and dispatching --------------------------------------------------------------

    def _start(self, wanted: int) -> None:
        """Start processes until so many workers are there, or will be."""
        missing = wanted - len(self._workers)
        if not self._job.policy.has_process:
            self._workers.extend(Worker(self._job) for _ in range(missing))
            return
        for policy in self._policies:
            mates = sum(worker.policy is policy for worker in self._workers)
            room = 0 if policy.address is None else self._most if self._is_shared else 1 - mates
            for _ in range(min(room, missing)):
                choice = replace(self._job.policy, address=policy.address)
                job = msgspec.structs.replace(self._job, policy=choice)
                self._workers.append(Worker(job, policy))
                missing -= 1
        coming = sum(not policy.is_ready for policy in self._policies)
        more = missing - coming if self._is_shared is False else 1 - len(self._policies)
        self._policies.extend(
            PolicyProcess(self._job.policy.name, self._job.policy.batching, self._job.limits)
            for _ in range(more)
        )

    def _dispatch(self) -> None:
        """Give waiting episodes to idle workers, and start more processes for the rest."""
        playing = len(self._playing)
        alone = self._schedule.has_suspects
        if alone and playing:
            return
        self._start(1 if alone else min(self._schedule.left + playing, self._most))
        for worker in self._workers:
            if worker.is_ready and worker.episode is None and self._schedule.left:
                worker.play(self._schedule.next(worker.task))
                if alone:
                    return

    # --- what processes say, and how they end --------------------------------------------------

    def _poll(self) -> Iterator[EpisodeResult]:
        """Wait for reports, a moment at most, and act on them."""
        children = [*self._policies, *self._workers]
        readable = wait([child.channel.socket for child in children], TICK_S)
        for child in children:
            if not self._has(child):
                continue
            reports, fault = _read(child, is_readable=child.channel.socket in readable)
            for report in reports:
                if self._has(child):
                    yield from self._receive(child, report)
            if not self._has(child):
                continue
            if fault is not None:
                self._lose(child, fault)
            elif isinstance(child, Worker):
                yield from self._check_episode(child)
            else:
                yield from self._check_answer(child)

    def _has(self, child: Worker | PolicyProcess) -> bool:
        return child in self._workers or child in self._policies

    def _receive(
        self, child: Worker | PolicyProcess, report: Report | Answering
    ) -> Iterator[EpisodeResult]:
        """Act on a report."""
        match child, report:
            case PolicyProcess(), Answering(address=address):
                child.address, child.is_ready = address, True
                self._is_shared = address.batching is not None
            case Worker(), Ready():
                if self._ready not in (None, report):
                    raise EvaluationError("The policy has changed while the run was going on.")
                self._ready = report
                self._failed_starts = 0
                child.is_ready = True
            case Worker(), Rehearsed():
                self._rehearsing = child.episode = None
            case Worker(), Progress(record=record):
                if child.episode and self._run.objection(record, child.episode) is None:
                    child.progress = record
            case Worker(), EpisodeResult():
                yield from self._accept(child, report)
            case Worker(), EpisodeError(fault=fault):
                self._note_fault(child, fault)
            case _, Refused(error=name, message=message):
                raise getattr(errors, name, EvaluationError).from_message(message)
            case _:
                _log.warning("A message that nobody asked for was dropped.")

    def _accept(self, worker: Worker, result: EpisodeResult) -> Iterator[EpisodeResult]:
        """Pass on what was asked for, and drop anything else."""
        if worker.episode is None:
            _log.warning("A result that nobody asked for was dropped.")
            return
        objection = result.objection(worker.episode, self._run, self._job.recording)
        if objection is None:
            worker.episode = None
            yield result
        else:
            self._lose(worker, f"its result was dropped: {objection}")

    def _note_fault(self, worker: Worker, fault: str) -> None:
        """Act on an episode that its worker could not play, most often for the policy's death."""
        policy = worker.policy
        if policy is not None and (death := policy.death_within(DEATH_SEEN_S)):
            self._lose(policy, death)
        elif worker.episode is not None and worker is self._rehearsing:
            self._schedule.note_fault(worker.episode, fault)
            worker.rehearse(worker.episode)
        elif worker.episode is not None:
            self._schedule.retry(worker.episode, fault)
            worker.episode = None

    def _lose(self, child: Worker | PolicyProcess, fault: str) -> None:
        """Let go of a process that is of no more use, and have what it played be played again."""
        if not child.is_ready:
            self._note_failed_start(fault)
        if isinstance(child, Worker):
            self._remove(child)
            if child.episode is not None:
                self._schedule.replay(child.episode, fault)
        else:
            played = self._drop_policy(child)
            if len(played) > 1:
                self._schedule.suspect(played)
            for episode in played[:1] if len(played) == 1 else ():
                self._schedule.replay(episode, f"of the policy, {fault}", alone=True)

    def _drop_policy(self, policy: PolicyProcess) -> list[Episode]:
        """End the process of a policy and its workers; what they were playing."""
        self._policies.remove(policy)
        policy.kill()
        mates = [worker for worker in self._workers if worker.policy is policy]
        for worker in mates:
            self._remove(worker)
        return [worker.episode for worker in mates if worker.episode is not None]

    def _remove(self, worker: Worker) -> None:
        self._workers.remove(worker)
        worker.kill()
        if worker is self._rehearsing:
            raise PolicyError(
                "The policy does not answer a first observation: its process ended, or did not "
                "come back. Nothing was played."
            )

    def _note_failed_start(self, fault: str) -> None:
        """Note that a process was of no use; too many in a row end the run."""
        self._failed_starts += 1
        if self._failed_starts == MAX_FAILED_STARTS:
            raise MachineryError(
                f"{MAX_FAILED_STARTS} workers in a row failed while they were starting, the "
                f"last one like this: {fault}"
            )

    # --- time limits ---------------------------------------------------------------------------

    def _check_answer(self, policy: PolicyProcess) -> Iterator[EpisodeResult]:
        """End a policy that hangs; alone with an episode, it has failed it."""
        act_s = self._job.limits.act_s
        if policy.clock.answer_s() <= act_s + HANG_S:
            return
        mates = [worker for worker in self._playing if worker.policy is policy]
        played = self._drop_policy(policy)
        if len(played) == 1:
            yield self._failed(mates[0], PolicyTimeoutError.of_answer(act_s))
        else:
            self._schedule.suspect(played)

    def _check_episode(self, worker: Worker) -> Iterator[EpisodeResult]:
        """Fail the episode of a policy that takes too long; its worker cannot be used again."""
        if worker.episode is None or self._ready is None:
            return
        limits = self._job.limits
        if worker.policy is not None:
            limits = replace(limits, act_s=float("inf"))
        if late := worker.clock.late(limits):
            self._remove(worker)
            yield self._failed(worker, late)
        elif worker.clock.episode_s() > limits.episode_s + GRACE_S:
            self._lose(worker, "the simulation did not come back within the time limit.")

    def _failed(self, worker: Worker, late: PolicyTimeoutError) -> EpisodeResult:
        """The result of an episode whose policy was stopped."""
        if worker.episode is None:
            raise AssertionError("Only an episode that is played can fail.")
        record = worker.progress or self._unknown(worker.episode)
        # The clock is shared memory, and nonsense in it must not end the run.
        steps = min(max(worker.clock.steps, record.steps), record.horizon)
        return EpisodeResult(record=record.broken(late, steps))

    def _unknown(self, episode: Episode) -> EpisodeRecord:
        """The record of an episode of which nothing is known."""
        if self._ready is None:
            raise AssertionError("An executor is prepared before it plays.")
        return EpisodeRecorder(episode).record(self._ready.run, self._ready.versions)


def _read(
    child: Worker | PolicyProcess, *, is_readable: bool
) -> tuple[Sequence[Report | Answering], str | None]:
    """What a process has said, and what has become of it if it is of no more use."""
    try:
        if is_readable:
            return child.channel.receive(), None
        return (), child.death()
    except EOFError:
        return (), child.death_within(DEATH_SEEN_S) or "its process closed the connection."
    except MessageError as error:
        return (), f"its result cannot be read ({error})."
