"""Playing on a Ray cluster, under the rules of the processes of one machine."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from duobench.errors import EvaluationError
from duobench.evaluation.episode import Job
from duobench.files import differences
from duobench.results.run import Run
from duobench.runners.messages import Ready
from duobench.runners.process_executor import MAX_FAILED_STARTS, ProcessExecutor
from duobench.runners.ray_cluster import Cluster, connect, disconnect, unmet
from duobench.runners.team import Team

_log = logging.getLogger(__name__)


class RayExecutor(ProcessExecutor):
    """Plays on the nodes of a cluster; this process alone writes, and no disk is shared.

    Each worker and each process of a policy is beside an actor. One that is lost, with its actor
    or its whole node, loses only what it was playing, which is played again.
    """

    def __init__(self, job: Job, workers: int, cluster: Cluster) -> None:
        """Remember what to play, and where.

        Args:
            job: What to play.
            workers: Most workers at a time, each of which asks for a core.
            cluster: The cluster.
        """
        self._cluster = cluster
        self._number = workers
        self._is_connected = False
        super().__init__(job, workers)
        # A node that is lost while its workers start takes all of them with it.
        self._most_failed_starts = MAX_FAILED_STARTS + workers

    def prepare(self) -> Run:
        """Connect to the cluster, start a first worker, and say what is played by what."""
        self._is_connected = connect(self._cluster)
        if lacking := unmet(self._cluster):
            _log.warning("No node of the cluster has %s yet; waiting for one.", lacking)
        return super().prepare()

    def close(self) -> None:
        """End every actor, with its process, and the connection."""
        super().close()
        if self._is_connected:
            disconnect()
            self._is_connected = False

    def _make_team(self) -> Team:
        from duobench.runners.ray_children import RemoteTeam

        return RemoteTeam(self._job, self._number, self._cluster)

    def _check_same(self, first: Ready, other: Ready) -> None:
        """Nodes may differ in processor and renderer, as records say, and in nothing else."""
        if first.run == other.run:
            return
        found: Sequence[str] = first.run.differences(other.run) or differences(
            first.run.versions, other.run.versions
        )
        raise EvaluationError(
            "The nodes of the cluster do not play the same: on one of them, the run has "
            f"{'; '.join(found)}. Install the same software, and the same policy, on all."
        )
