"""Where episodes are played: in this process, or in processes of their own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Protocol

from duobench.errors import EvaluationError, MachineryError, RenderingError
from duobench.evaluation.episode import EpisodeResult, EpisodeRunner, Job
from duobench.evaluation.policies import find_source
from duobench.policy.registry import PolicyKind
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.runners.process_executor import ProcessExecutor
from duobench.runners.ray_cluster import Cluster
from duobench.runners.schedule import Schedule
from duobench.sim import rendering

_MAY_SEE = (PolicyKind.LEROBOT, PolicyKind.MODULE, PolicyKind.SERVED)
"""Kinds of policies that may ask for images."""


class Executor(Protocol):
    """Something that plays episodes, in whatever processes, and writes nothing."""

    @property
    def unplayed(self) -> Mapping[Episode, str]:
        """Episodes that could not be played because a process died in them each time, and why."""
        ...

    def prepare(self) -> Run:
        """Make the policy, and say what is played by what.

        Raises:
            DuoBenchError: If the policy cannot be made.
        """
        ...

    def rehearse(self, episode: Episode) -> None:
        """Have the policy answer the first observation of an episode, after `prepare`.

        A scripted policy is not asked: it answers whatever it sees.

        Raises:
            PolicyError: If it fails, or its answer is no chunk of actions.
            MachineryError: If it cannot be asked.
            DuoBenchError: If the policy does not fit, or an environment cannot be made.
        """
        ...

    def play(self, episodes: Sequence[Episode]) -> Iterator[EpisodeResult]:
        """Play episodes, each exactly once, after `prepare`; what cannot be played is `unplayed`.

        Args:
            episodes: What to play, in any order.

        Yields:
            Their results, in the order in which they are finished.

        Raises:
            MachineryError: If what they need is not there.
            DuoBenchError: If the policy does not fit, or an environment cannot be made.
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
        """Remember what to play, and how."""
        self._job = job
        self._schedule = Schedule()
        self._runner: EpisodeRunner | None = None
        self.unplayed: Mapping[Episode, str] = {}
        """None: a death ends this process too."""

    def prepare(self) -> Run:
        """Make the policy, and say what is played by what."""
        job = self._job
        source = find_source(job.policy, job.suite.tasks, job.limits)
        self._runner = EpisodeRunner(source, job)
        return self._runner.run

    def rehearse(self, episode: Episode) -> None:
        """Have the policy answer a first observation."""
        if not self._job.policy.is_scripted:
            self._prepared.rehearse(episode)

    def play(self, episodes: Sequence[Episode]) -> Iterator[EpisodeResult]:
        """Play episodes in their order."""
        runner = self._prepared
        for episode in episodes:
            result = None
            while result is None:
                try:
                    result = runner.play(episode)
                except MachineryError as fault:
                    self._schedule.note_fault(episode, str(fault))
            yield result

    def failures(self) -> Iterator[EpisodeResult]:
        """None."""
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
    """What does a job.

    Args:
        job: What to play.
        workers: Processes that play side by side; with 0 this process plays.
        cluster: The Ray cluster on which they are; None for this machine alone.

    Raises:
        EvaluationError: If the number of workers is negative, or 0 on a cluster, or Ray cannot be
            used.
        RenderingError: If there are to be videos, and nothing renders.
    """
    if workers < 0:
        raise EvaluationError(
            f"The number of workers is 1 or more, or 0 for this process alone; got {workers}."
        )
    if cluster is not None:
        return _on_cluster(job, workers, cluster)
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


def _on_cluster(job: Job, workers: int, cluster: Cluster) -> Executor:
    from duobench.runners.ray_cluster import check_environment
    from duobench.runners.ray_executor import RayExecutor

    if workers == 0:
        raise EvaluationError("On a cluster there is at least one worker; got 0.")
    check_environment()
    return RayExecutor(job, workers, cluster)
