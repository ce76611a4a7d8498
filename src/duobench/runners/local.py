"""Playing episodes in this process, one after the other."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property

from duobench.errors import MachineryError, TaskFailedError, UnplayedError
from duobench.evaluation.episode import EpisodeResult, EpisodeRunner, Job
from duobench.evaluation.policies import find_source
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.results.attempts import MACHINERY, MOST_POLICY_ENDS, POLICY
from duobench.results.records import EpisodeRecord, FirstAnswer
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.runners.schedule import LOST, AttemptLog, Schedule, end_of, ended_twice


class LocalExecutor:
    """Plays in this process: for debugging, notebooks and tests.

    The policy shares it with the simulator, which it can see and move. It cannot outlive a policy
    that ends its process, it cannot stop one that hangs (an answer that comes too late fails the
    episode once it comes), and it leaves alone what a policy has started. `ProcessExecutor` does
    all of that, with one worker too.
    """

    def __init__(self, job: Job) -> None:
        self._job = job
        self._schedule = Schedule()
        self._ending = ExitStack()
        self._progress: EpisodeRecord | None = None
        self.unplayed: Mapping[Episode, UnplayedError] = self._schedule.abandoned
        """Those whose task has failed, and why; a death ends this process too."""

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
        """Have the policy answer a first observation twice; see `ProcessExecutor`."""
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
        """What a fault makes of an episode; None if it is played again, or not any more."""
        record, how = self._progress, end_of(fault)
        if how == POLICY and record is not None and record.end is not None:
            return EpisodeResult(record=record)  # it was played on after its horizon
        if how == POLICY and log.policy_ends(episode) + 1 >= MOST_POLICY_ENDS:
            record = record or EpisodeRecorder(episode).record(
                self._runner.run, self._runner.versions
            )
            return EpisodeResult(record=record.broken(ended_twice(LOST, str(fault)), record.steps))
        log.lose(episode, how)
        if isinstance(fault, TaskFailedError):
            self._schedule.abandoned[episode] = fault
        elif how == MACHINERY:
            self._schedule.note_fault(episode, str(fault))
        return None

    def _note_progress(self, record: EpisodeRecord) -> None:
        self._progress = record

    def failures(self) -> Iterator[EpisodeResult]:
        """Nothing."""
        return iter(())

    def close(self) -> None:
        """Free environment and policy."""
        self._ending.close()
