"""Playing in processes that may hang or die without harm, simulators apart from policies."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace

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
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.runners.child import Refused
from duobench.runners.messages import (
    EpisodeError,
    Progress,
    Ready,
    Rehearsed,
    Report,
)
from duobench.runners.policy_process import Answering, PolicyProcess
from duobench.runners.schedule import Schedule
from duobench.runners.team import Team
from duobench.runners.worker import Worker

_log = logging.getLogger(__name__)

MAX_FAILED_STARTS = 3
"""Processes that die one after the other while they start, until the run gives up."""
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
        """Remember what to play, by at most so many workers, which are started when needed.

        Args:
            job: What to play.
            workers: Most workers at a time.
        """
        self._job = job
        self._schedule = Schedule()
        self._most = workers
        self._team = self._make_team()
        self._failed_starts = 0
        self._most_failed_starts = MAX_FAILED_STARTS
        self._ready: Ready | None = None
        self._rehearsing: Worker | None = None
        self._at_horizon: dict[Episode, EpisodeRecord] = {}

    def _make_team(self) -> Team:
        """Who does the job, without a process yet."""
        return Team(self._job)

    @property
    def unplayed(self) -> dict[Episode, str]:
        """Episodes that could not be played, and why, in words."""
        return self._schedule.set_aside

    def prepare(self) -> Run:
        """Start a first worker, and say what is played by what."""
        while self._ready is None:
            self._team.start(1)
            for _ in self._poll():
                pass
        return self._ready.run

    def rehearse(self, episode: Episode) -> None:
        """Have the policy answer a first observation."""
        if self._job.policy.is_scripted:
            return
        (self._rehearsing,) = self._team.workers
        self._rehearsing.rehearse(episode)
        while self._rehearsing is not None:
            for _ in self._poll():
                pass

    def play(self, episodes: Sequence[Episode]) -> Iterator[EpisodeResult]:
        """Play episodes; those of a task go to as few workers as keeps all of them busy."""
        self._schedule.add(episodes)
        while self._schedule.left or self._team.playing:
            self._dispatch()
            yield from self._poll()
        for episode in self._at_horizon.keys() & self.unplayed.keys():
            del self.unplayed[episode]
            yield EpisodeResult(record=self._at_horizon.pop(episode))

    def failures(self) -> Iterator[EpisodeResult]:
        """What is unplayed, as episodes that failed with an error."""
        for episode, why in self.unplayed.items():
            record = self._unknown(episode)
            yield EpisodeResult(record=record.broken(UnplayedError(f"It was not played: {why}"), 0))

    def close(self) -> None:
        """Let processes free what they hold, then end them and all that they have started."""
        self._team.close()

    @property
    def _run(self) -> Run:
        if self._ready is None:
            raise AssertionError("An executor is prepared before it plays.")
        return self._ready.run

    def _dispatch(self) -> None:
        """Give waiting episodes to idle workers, and start more processes for the rest."""
        playing = len(self._team.playing)
        alone = self._schedule.has_suspects
        if alone and playing:
            return
        self._team.start(1 if alone else min(self._schedule.left + playing, self._most))
        for worker in self._team.workers:
            if worker.is_ready and worker.episode is None and self._schedule.left:
                worker.play(self._schedule.next(worker.task))
                if alone:
                    return

    # --- what processes say, and how they end --------------------------------------------------

    def _poll(self) -> Iterator[EpisodeResult]:
        """Wait for reports, a moment at most, and act on them."""
        children = self._team.children
        readable = self._team.wait(TICK_S)
        for child in children:
            if child not in self._team.children:
                continue
            reports, fault = _read(child, is_readable=child in readable)
            for report in reports:
                if child in self._team.children:
                    yield from self._receive(child, report)
            if child not in self._team.children:
                continue
            if fault is not None:
                self._lose(child, fault)
            elif isinstance(child, Worker):
                yield from self._check_episode(child)
            else:
                yield from self._check_answer(child)

    def _receive(
        self, child: Worker | PolicyProcess, report: Report | Answering
    ) -> Iterator[EpisodeResult]:
        """Act on a report."""
        if isinstance(report, Refused):
            raise getattr(errors, report.error, EvaluationError).from_message(report.message)
        if isinstance(child, Worker):
            yield from self._receive_from_worker(child, report)
        elif isinstance(report, Answering):
            self._team.note_address(child, report.address)

    def _receive_from_worker(
        self, worker: Worker, report: Report | Answering
    ) -> Iterator[EpisodeResult]:
        match report:
            case Ready():
                if self._ready is not None:
                    self._check_same(self._ready, report)
                self._ready = report
                self._failed_starts = 0
                worker.is_ready = True
            case Rehearsed():
                self._rehearsing = worker.episode = None
            case Progress(record=record):
                self._note_progress(worker, record)
            case EpisodeResult():
                yield from self._accept(worker, report)
            case EpisodeError(fault=fault):
                self._note_fault(worker, fault)
            case _:
                _log.warning("A message that nobody asked for was dropped.")

    def _note_progress(self, worker: Worker, record: EpisodeRecord) -> None:
        """Note how far the episode of a worker is, and the end of one that is played on."""
        if worker.episode and self._run.objection(record, worker.episode) is None:
            worker.progress = record
            if record.end is not None:
                self._at_horizon.setdefault(worker.episode, record)

    def _check_same(self, first: Ready, other: Ready) -> None:
        """Check that two workers play the same.

        Raises:
            EvaluationError: They do not.
        """
        if first != other:
            raise EvaluationError("The policy has changed while the run was going on.")

    def _accept(self, worker: Worker, result: EpisodeResult) -> Iterator[EpisodeResult]:
        """Pass on what was asked for, and drop anything else."""
        if worker.episode is None:
            _log.warning("A result that nobody asked for was dropped.")
            return
        objection = result.objection(worker.episode, self._run, self._job.recording)
        if objection is None:
            kept = self._at_horizon.pop(worker.episode, None)
            worker.episode = None
            if kept and kept != replace(result.record, late_success=None):
                result = EpisodeResult(record=kept)  # a second attempt cannot improve on it
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
        for worker in self._team.wait(0):  # what they said before their policy died
            if isinstance(worker, Worker) and worker.policy is child:
                for report in _read(worker, is_readable=True)[0]:
                    if isinstance(report, Progress):
                        self._note_progress(worker, report.record)
        played = self._remove(child)
        if len(played) > 1:
            self._schedule.suspect(played)
        elif isinstance(child, Worker):
            self._schedule.replay(played, fault)
        else:
            self._schedule.replay(played, f"of the policy, {fault}", alone=True)

    def _remove(self, child: Worker | PolicyProcess) -> list[Episode]:
        """End a process, with the workers that need it; what they were playing."""
        removed = self._team.remove(child)
        if self._rehearsing in removed:
            raise PolicyError(
                "The policy does not answer a first observation: its process ended, or did not "
                "come back. Nothing was played."
            )
        return [worker.episode for worker in removed if worker.episode is not None]

    def _note_failed_start(self, fault: str) -> None:
        """Note that a process was of no use; too many in a row end the run."""
        self._failed_starts += 1
        if self._failed_starts == self._most_failed_starts:
            raise MachineryError(
                f"{self._most_failed_starts} workers in a row failed while they were starting, the "
                f"last one like this: {fault}"
            )

    # --- time limits ---------------------------------------------------------------------------

    def _check_answer(self, policy: PolicyProcess) -> Iterator[EpisodeResult]:
        """End a policy that hangs; alone with an episode, it has failed it."""
        act_s = self._job.limits.act_timeout
        if policy.clock.answer_s() <= act_s + HANG_S:
            return
        mates = [worker for worker in self._team.playing if worker.policy is policy]
        played = self._remove(policy)
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
            limits = replace(limits, act_timeout=float("inf"))
        if late := worker.clock.late(limits):
            self._remove(worker)
            yield self._failed(worker, late)
        elif worker.clock.episode_s() > limits.episode_timeout + GRACE_S:
            self._lose(worker, "the simulation did not come back within the time limit.")

    def _failed(self, worker: Worker, late: PolicyTimeoutError) -> EpisodeResult:
        """The result of an episode whose policy was stopped."""
        if worker.episode is None:
            raise AssertionError("Only an episode that is played can fail.")
        if record := self._at_horizon.pop(worker.episode, None):
            return EpisodeResult(record=record)
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
            return child.receive(), None
        return (), child.death()
    except EOFError:
        return (), child.death_within(DEATH_SEEN_S) or "its process closed the connection."
    except MessageError as error:
        return (), f"its result cannot be read ({error})."
