"""Executors, which play episodes in this process or in processes of their own.

The latter may hang or die without harm, and have simulators apart from policies.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import cached_property

from duobench.core.errors import (
    EvaluationError,
    MachineryError,
    MessageError,
    PolicyError,
    PolicyTimeoutError,
    RenderingError,
    TaskFailedError,
    UnplayedError,
    error_class,
    escaped,
)
from duobench.core.files import differences
from duobench.evaluation.episode import EpisodeResult, EpisodeRunner, Job
from duobench.evaluation.policies import find_source
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.runners.policy_process import Answering
from duobench.evaluation.runners.pool import (
    Launcher,
    LocalLauncher,
    RunningPolicy,
    Worker,
    WorkerPool,
)
from duobench.evaluation.runners.process import (
    DEATH_SEEN_S,
    ProcessFailed,
    death_within,
)
from duobench.evaluation.runners.ray_cluster import RayLauncher, check_environment
from duobench.evaluation.runners.ray_process import Cluster
from duobench.evaluation.runners.schedule import (
    LOST,
    AttemptLog,
    Schedule,
    end_of,
    ended_twice,
)
from duobench.evaluation.runners.worker import (
    EpisodeError,
    EpisodeProgress,
    Ready,
    Rehearsed,
    Report,
)
from duobench.results.attempts import (
    MACHINERY,
    MOST_POLICY_ENDS,
    NODE,
    POLICY,
    SHARED,
    TASK,
    WORKER,
)
from duobench.results.records import FirstAnswer, Record
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.world.sim import rendering

_log = logging.getLogger(__name__)

HANG_S = 1.0
"""Seconds that a policy's process may be late before it is ended: one that comes back
until then says itself that it was too slow."""
TICK_S = 0.1
"""Seconds between checks of deaths and time limits."""
GRACE_S = 60.0
"""Seconds that an episode may exceed its time limit without its policy being busy."""
_ENDED = "the policy's process ended by itself"


class LocalExecutor:
    """Plays in this process: for debugging, notebooks and tests.

    The policy shares it with the simulator, which it can see and move. It cannot outlive a policy
    that ends its process, it cannot stop one that hangs (a chunk that comes too late fails the
    episode once it comes), and it leaves alone what a policy has started. `ProcessExecutor` does
    all of that, with one worker too.
    """

    def __init__(self, job: Job) -> None:
        self._job = job
        self._schedule = Schedule()
        self._ending = ExitStack()
        self._progress: Record | None = None
        self.unplayed: Mapping[Episode, UnplayedError] = self._schedule.abandoned
        """Episodes whose task failed, with the error; a death ends this process too."""

    @cached_property
    def _runner(self) -> EpisodeRunner:
        job = self._job
        source = find_source(job.policy, job.suite.tasks, job.limits)
        runner = EpisodeRunner(source, job, tell=self._note_progress)
        self._ending.callback(runner.close)
        return runner

    def prepare(self) -> Run:
        """Make the policy, and say what is played by what."""
        return self._runner.run

    def rehearse(self, episode: Episode) -> FirstAnswer:
        """Let the policy act twice on a first observation; see `ProcessExecutor`."""
        return self._runner.rehearse(episode)

    def play(
        self, episodes: Sequence[Episode], log: AttemptLog | None = None
    ) -> Iterator[EpisodeResult]:
        """Play episodes in their order; see `ProcessExecutor`."""
        log = log or AttemptLog()
        for episode in episodes:
            result = None
            while result is None and episode not in self.unplayed:
                log.begin(episode)
                self._progress = None
                try:
                    result = self._runner.play(episode)
                except MachineryError as fault:
                    result = self._after(episode, fault, log)
            if result is not None:
                yield result

    def _after(
        self, episode: Episode, fault: MachineryError, log: AttemptLog
    ) -> EpisodeResult | None:
        """Result of an episode after a fault; None if it is played again, or not any more."""
        record, how = self._progress, end_of(fault)
        if how == POLICY and log.policy_ends(episode) + 1 >= MOST_POLICY_ENDS:
            record = record or EpisodeRecorder(episode).record(
                self._runner.run, self._runner.versions
            )
            return EpisodeResult(
                record=record.broken(ended_twice(LOST, str(fault)), record.steps)
            )
        log.lose(episode, how)
        if isinstance(fault, TaskFailedError):
            self._schedule.abandoned[episode] = fault
        elif how == MACHINERY:
            self._schedule.note_fault(episode, str(fault))
        return None

    def _note_progress(self, record: Record) -> None:
        self._progress = record

    def failures(self) -> Iterator[EpisodeResult]:
        """Nothing."""
        return iter(())

    def close(self) -> None:
        """Free environment and policy."""
        self._ending.close()


class ProcessExecutor:
    """Plays in processes of their own, side by side; one that hangs or dies is replaced.

    A scripted policy plays in its worker. Any other has a process without a simulator: a
    `BatchPolicy` one for all workers, a plain policy one beside each. They are new processes that
    import only what they need: a script that calls this needs no `if __name__ == "__main__":`.

    Args:
        job: What to play.
        workers: Most workers at a time, which are started when needed.
        launcher: What starts them; None starts them on this machine.
    """

    def __init__(
        self, job: Job, workers: int, launcher: Launcher | None = None
    ) -> None:
        self._job, self._most = job, workers
        self._launcher: Launcher = launcher or LocalLauncher()
        self._schedule = Schedule()
        self._pool = WorkerPool(job, self._launcher)
        self._failed_starts = 0
        self._ready: Ready | None = None
        self._rehearsing: Worker | None = None
        self._first_answer: FirstAnswer | None = None
        self._isolated: Episode | None = None
        """The episode that was begun last, if nothing is played beside it."""
        self._log = AttemptLog()
        self.unplayed = self._schedule.abandoned
        """Episodes that could not be played, because a process died in them each time or because
        their task failed, and why."""

    def prepare(self) -> Run:
        """Start a first worker, and say what is played by what."""
        self._launcher.open()
        while self._ready is None:
            self._pool.start(1)
            for _ in self._poll():
                pass
        return self._ready.run

    def rehearse(self, episode: Episode) -> FirstAnswer:
        """Let the policy act twice on the first observation of an episode, after `prepare`.

        Raises:
            PolicyError: It fails, or returns no chunk of actions.
            TaskFailedError: The task has failed before the policy was asked.
        """
        (self._rehearsing,) = self._pool.workers
        self._rehearsing.rehearse(episode)
        while self._first_answer is None:
            for _ in self._poll():
                pass
        return self._first_answer

    def play(
        self, episodes: Sequence[Episode], log: AttemptLog | None = None
    ) -> Iterator[EpisodeResult]:
        """Play episodes in any order, each exactly once; what cannot be played is `unplayed`.

        Those of a task go to as few workers as keeps all of them busy. The log is told of every
        attempt at an episode, before it begins and when it has ended without a record.

        Raises:
            MachineryError: What they need is not there.
            DuoBenchError: The policy does not fit, or an environment cannot be made.
        """
        self._log = log or self._log
        self._schedule.add(episodes)
        while self._schedule.left or self._pool.playing:
            self._dispatch()
            yield from self._poll()

    def failures(self) -> Iterator[EpisodeResult]:
        """Unplayed episodes as failures with an error, but not those whose task failed."""
        for episode, why in self.unplayed.items():
            if not isinstance(why, TaskFailedError):
                error = UnplayedError(f"It was not played: {why}")
                yield EpisodeResult(record=self._unknown(episode).broken(error, 0))

    def close(self) -> None:
        """Let processes free what they hold, then end them and all that they have started."""
        self._pool.close()
        self._launcher.close()

    @property
    def _prepared(self) -> Ready:
        if self._ready is None:
            raise AssertionError("An executor is prepared before it plays.")
        return self._ready

    def _dispatch(self) -> None:
        episodes = [worker.episode for worker in self._pool.playing]
        playing, isolated = len(episodes), self._schedule.has_quarantined
        if self._isolated in episodes or (isolated and playing):
            return
        self._isolated = None
        self._pool.start(
            1 if isolated else min(self._schedule.left + playing, self._most)
        )
        for worker in self._pool.workers:
            if worker.is_ready and worker.episode is None and self._schedule.left:
                episode = self._schedule.next(worker.task)
                self._log.begin(episode)
                worker.play(episode)
                if isolated:
                    self._isolated = episode
                    return
        self._pool.note_company()

    # --- what processes say, and how they end --------------------------------------------------

    def _poll(self) -> Iterator[EpisodeResult]:
        members = self._pool.members
        readable = self._pool.wait(TICK_S)
        for member in members:
            if member not in self._pool.members:
                continue
            reports, fault = _read(member, is_readable=member in readable)
            for report in reports:
                if member in self._pool.members:
                    yield from self._receive(member, report)
            if member not in self._pool.members:
                continue
            if fault is not None:
                yield from self._lose(member, fault)
            elif isinstance(member, Worker):
                yield from self._check_episode(member)
            else:
                yield from self._check_answer(member)

    def _receive(
        self, member: Worker | RunningPolicy, report: Report | Answering
    ) -> Iterator[EpisodeResult]:
        match member, report:
            case RunningPolicy(is_ready=True), _:  # which has nothing to say any more
                yield from self._lose(member, "it sent an unrequested message.")
            case _, ProcessFailed(error=kind, message=text):
                raise error_class(kind).from_message(escaped(text))
            case RunningPolicy(), Answering(address=address):
                self._pool.note_address(member, address)
            case Worker(), Ready(run=run):
                self._check_same(run)
                self._ready = report
                self._failed_starts = 0
                member.is_ready = True
            case Worker(), Rehearsed(answer=answer):
                self._rehearsing = member.episode = None
                self._first_answer = answer
            case Worker(), EpisodeProgress(record=record):
                self._note_progress(member, record)
            case Worker(), EpisodeResult():
                yield from self._accept(member, report)
            case Worker(), EpisodeError():
                yield from self._note_fault(member, report)
            case _:
                _log.warning("An unrequested message was dropped.")

    def _note_progress(self, worker: Worker, record: Record) -> None:
        """Note how far the episode of a worker is."""
        if (
            worker.episode
            and self._prepared.run.objection(record, worker.episode) is None
        ):
            worker.progress = record

    def _check_same(self, run: Run) -> None:
        """Workers may differ in processor and renderer, as records say, and in nothing else."""
        if self._ready is None or self._ready.run.hash == run.hash:
            return
        first = self._ready.run
        found = first.differences(run) or differences(first.versions, run.versions)
        raise EvaluationError(
            f"Workers do not play the same: one of them has {'; '.join(found) or 'other details'}. "
            "The policy has changed while the run was going on, or nodes of a cluster have other "
            "software: install the same on all."
        )

    def _accept(self, worker: Worker, result: EpisodeResult) -> Iterator[EpisodeResult]:
        """Pass on what was asked for, and drop anything else."""
        if worker.episode is None:
            _log.warning("An unrequested result was dropped.")
            return
        objection = result.objection(
            worker.episode, self._prepared.run, self._job.recording
        )
        if objection is None:
            worker.episode = None
            yield result
        else:
            yield from self._lose(worker, f"its result was dropped: {objection}")

    def _note_fault(
        self, worker: Worker, report: EpisodeError
    ) -> Iterator[EpisodeResult]:
        """Act on an episode that its worker could not play, most often for the policy's death."""
        policy = worker.policy
        episode = worker.episode
        how = report.how
        if (
            how != TASK
            and policy
            and (death := death_within(policy.process, DEATH_SEEN_S))
        ):
            yield from self._lose(policy, death)
            return
        if episode is None:
            return
        if worker is self._rehearsing:
            self._rehearse_again(worker, episode, report)
            return
        if how == POLICY and policy:
            yield from self._lose(policy, report.fault)
            return
        worker.episode = None
        if how == POLICY and worker.is_alone:
            yield from self._end(worker, episode, report.fault, LOST)
        elif how == POLICY:
            self._share([episode])
        elif how == TASK:
            self._log.lose(episode, how)
            self._schedule.abandoned[episode] = TaskFailedError(report.fault)
        else:
            self._log.lose(episode, how)
            self._schedule.retry(episode, report.fault)

    def _rehearse_again(
        self, worker: Worker, episode: Episode, report: EpisodeError
    ) -> None:
        """Let a policy act once more, unless that cannot help."""
        if report.how == TASK:
            self._rehearsing = worker.episode = None
            raise TaskFailedError(report.fault)
        if report.how == POLICY:
            raise PolicyError(
                f"The policy does not answer a first observation: {report.fault}"
            )
        self._schedule.note_fault(episode, report.fault)
        worker.rehearse(episode)

    def _lose(
        self, member: Worker | RunningPolicy, fault: str
    ) -> Iterator[EpisodeResult]:
        """Let go of a process that is of no more use, and have what it played be played again."""
        mine = [each for each in self._pool.workers if member in (each, each.policy)]
        if not any(worker.is_ready for worker in mine):
            self._failed_starts += 1
            if self._failed_starts == self._launcher.max_failed_starts:
                raise MachineryError(
                    f"{self._failed_starts} workers in a row failed while they were starting, the "
                    f"last one like this: {fault}"
                )
        yield from self._hear(member)
        mates = {worker.episode: worker for worker in self._pool.playing}
        played, is_taken = self._remove(member), member.process.is_taken
        if len(played) > 1:
            self._share(played, NODE if is_taken else SHARED)
        elif isinstance(member, Worker) or is_taken:
            for episode in played:
                self._log.lose(episode, NODE if is_taken else WORKER)
            self._schedule.replay(played, fault)
        else:
            for episode in played:
                yield from self._end(mates[episode], episode, fault)

    def _hear(self, policy: Worker | RunningPolicy) -> Iterator[EpisodeResult]:
        """Take what workers have said before their policy died."""
        for worker in self._pool.wait(0):
            if isinstance(worker, Worker) and worker.policy is policy:
                for report in _read(worker, is_readable=True)[0]:
                    if isinstance(report, EpisodeProgress | EpisodeResult):
                        yield from self._receive(worker, report)

    def _share(self, episodes: Sequence[Episode], how: str = SHARED) -> None:
        """Play episodes one at a time if one of them ended the policy of all."""
        for episode in episodes:
            self._log.lose(episode, how)
        self._schedule.quarantine(episodes)

    def _end(
        self, worker: Worker, episode: Episode, fault: str, what: str = _ENDED
    ) -> Iterator[EpisodeResult]:
        """Fail an episode whose policy has ended by itself again."""
        if self._log.policy_ends(episode) + 1 >= MOST_POLICY_ENDS:
            yield self._failed(worker, episode, ended_twice(what, fault))
        else:
            self._log.lose(episode, POLICY)
            self._schedule.quarantine([episode])

    def _remove(self, member: Worker | RunningPolicy) -> list[Episode]:
        """End a process, with the workers that need it; what they were playing."""
        removed = self._pool.remove(member)
        if self._rehearsing in removed:
            raise PolicyError(
                "The policy does not answer a first observation: its process ended, or did not "
                "come back. Nothing was played."
            )
        return [worker.episode for worker in removed if worker.episode is not None]

    # --- time limits ---------------------------------------------------------------------------

    def _check_answer(self, policy: RunningPolicy) -> Iterator[EpisodeResult]:
        """End a policy that hangs; alone with an episode, it has failed it."""
        act_s = self._job.limits.act_timeout
        if policy.process.clock().act_s <= act_s + HANG_S:
            return
        mates = [worker for worker in self._pool.playing if worker.policy is policy]
        played = self._remove(policy)
        if len(played) == 1:
            yield self._failed(mates[0], played[0], PolicyTimeoutError.of_answer(act_s))
        else:
            self._share(played)

    def _check_episode(self, worker: Worker) -> Iterator[EpisodeResult]:
        """Fail the episode of a policy that takes too long; its worker cannot be used again."""
        if worker.episode is None:
            return
        limits = self._job.limits
        if (
            worker.policy or self._job.policy.server
        ):  # which says itself that it is late, or gone
            limits = replace(limits, act_timeout=float("inf"))
        clock = worker.process.clock()
        late = clock.late(limits)
        if late:
            (episode,) = self._remove(worker)
            yield self._failed(worker, episode, late)
        elif clock.episode_s > limits.episode_timeout + GRACE_S:
            yield from self._lose(
                worker, "the simulation did not come back within the time limit."
            )

    def _failed(
        self, worker: Worker, episode: Episode, error: PolicyError
    ) -> EpisodeResult:
        record = worker.progress or self._unknown(episode)
        # The clock is shared memory, and nonsense in it must not end the run.
        steps = min(max(worker.process.clock().steps, record.steps), record.horizon)
        return EpisodeResult(record=record.broken(error, steps))

    def _unknown(self, episode: Episode) -> Record:
        ready = self._prepared
        return EpisodeRecorder(episode).record(ready.run, ready.versions)


def _read(
    member: Worker | RunningPolicy, *, is_readable: bool
) -> tuple[Sequence[Report | Answering], str | None]:
    """Return the messages of a process, and how it ended if it is of no more use."""
    process = member.process
    try:
        if is_readable:
            return process.receive(), None
        return (), process.death()
    except EOFError:
        return (), death_within(
            process, DEATH_SEEN_S
        ) or "its process closed the connection."
    except MessageError as error:
        return (), f"what it sent cannot be read ({error})."


Executor = LocalExecutor | ProcessExecutor
"""Executor that plays episodes, in this process or others, and writes nothing."""


def executor_for(
    job: Job,
    workers: int,
    cluster: Cluster | None = None,
) -> Executor:
    """Return an executor of a job, with so many processes side by side, or with 0 in this one."""
    if workers < 0:
        raise EvaluationError(
            f"The number of workers is 1 or more, or 0 for this process alone; got {workers}."
        )
    if cluster is not None:
        if workers == 0:
            raise EvaluationError("On a cluster there is at least one worker; got 0.")
        check_environment()
        return ProcessExecutor(job, workers, RayLauncher(cluster, job, workers))
    if workers == 0:
        return LocalExecutor(job)
    # How to render is chosen before there are workers, so that not each of them finds out for
    # itself. Only its worker knows whether a policy sees images: it is the one to complain.
    if job.videos:
        rendering.choose(processes=workers)
    elif job.policy.kind.may_see and workers > 1:
        with suppress(RenderingError):
            rendering.choose(processes=workers)
    return ProcessExecutor(job, workers)
