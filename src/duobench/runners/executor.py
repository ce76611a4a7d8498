"""Where episodes are played: in this process, or in processes of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Protocol

from duobench.errors import EvaluationError, MachineryError, RenderingError
from duobench.evaluation.episode import EpisodeResult, EpisodeRunner, Job
from duobench.evaluation.policies import find_source
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.runners.process_executor import ProcessExecutor
from duobench.runners.ray_cluster import RayLauncher, check_environment
from duobench.runners.ray_process import Cluster
from duobench.runners.schedule import Schedule
from duobench.sim import rendering


class Executor(Protocol):
    """Something that plays episodes, in whatever processes, and writes nothing."""

    @property
    def unplayed(self) -> Mapping[Episode, str]:
        """Episodes that could not be played because a process died in them each time, and why."""
        ...

    def prepare(self) -> Run:
        """Make the policy, and say what is played by what."""
        ...

    def rehearse(self, episode: Episode) -> None:
        """Have the policy answer the first observation of an episode, after `prepare`.

        A scripted policy is not asked: it answers whatever it sees.

        Raises:
            PolicyError: It fails, or its answer is no chunk of actions.
        """
        ...

    def play(
        self, episodes: Sequence[Episode], begun: Callable[[Episode], None] = ...
    ) -> Iterator[EpisodeResult]:
        """Play episodes in any order, each exactly once; what cannot be played is `unplayed`.

        Whenever an attempt at an episode is going to begin, `begun` is told.

        Raises:
            MachineryError: What they need is not there.
            DuoBenchError: The policy does not fit, or an environment cannot be made.
        """
        ...

    def failures(self) -> Iterator[EpisodeResult]:
        """What is `unplayed`, as episodes that failed with an error."""
        ...

    def close(self) -> None:
        """End every process, and whatever the policy has started in it."""
        ...


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
        self._runner: EpisodeRunner | None = None
        self.unplayed: Mapping[Episode, str] = {}
        """None: a death ends this process too."""

    def prepare(self) -> Run:
        """Make the policy, and say what is played by what."""
        job = self._job
        self._runner = EpisodeRunner(find_source(job.policy, job.suite.tasks, job.limits), job)
        return self._runner.run

    def rehearse(self, episode: Episode) -> None:
        """Have the policy answer a first observation."""
        if not self._job.policy.is_scripted:
            self._prepared.rehearse(episode)

    def play(
        self, episodes: Sequence[Episode], begun: Callable[[Episode], None] = lambda _episode: None
    ) -> Iterator[EpisodeResult]:
        """Play episodes in their order."""
        runner = self._prepared
        for episode in episodes:
            result = None
            while result is None:
                begun(episode)
                try:
                    result = runner.play(episode)
                except MachineryError as fault:
                    self._schedule.note_fault(episode, str(fault))
            yield result

    def failures(self) -> Iterator[EpisodeResult]:
        """Nothing."""
        return iter(())

    def close(self) -> None:
        """Free environment and policy."""
        if self._runner is not None:
            self._runner.close()
            self._runner = None

    @property
    def _prepared(self) -> EpisodeRunner:
        if self._runner is None:
            raise AssertionError("An executor is prepared before it plays.")
        return self._runner


def executor_for(job: Job, workers: int, cluster: Cluster | None = None) -> Executor:
    """What does a job, with so many processes side by side, or with 0 in this one.

    Raises:
        EvaluationError: The number of workers is negative, or 0 on a cluster, or there is no Ray.
        RenderingError: There are to be videos, and nothing renders.
    """
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
    elif job.policy.may_see and workers > 1:
        with suppress(RenderingError):
            rendering.choose(processes=workers)
    return ProcessExecutor(job, workers)
