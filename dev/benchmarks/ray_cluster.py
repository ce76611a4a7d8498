"""A Ray cluster on this machine, of several nodes with processes of their own.

`ray` is imported by its functions alone, so that other benchmarks run without it.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

MEMORY = 80_000_000
"""Bytes of a node's object store, for which this is about the least that Ray takes."""
STARTS = 3
"""How often a node is started that does not come."""
ENVIRONMENT = {
    "RAY_AUTH_MODE": "token",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",  # a busy machine would starve processes that are nicer
    "RAY_DISABLE_IMPORT_WARNING": "1",
}
"""Variables of the nodes, and of whoever uses them."""


class LocalCluster:
    """Nodes on this machine, all started by this process."""

    def __init__(self, nodes: int, cpus: int) -> None:
        """Start them.

        Args:
            nodes: How many.
            cpus: Cores that each says it has.
        """
        set_environment()
        from ray.cluster_utils import Cluster  # pyright: ignore[reportMissingImports]

        self._options = {"num_cpus": cpus, "object_store_memory": MEMORY}
        # A graphics card that only Ray believes in, to see who is given it.
        head = {**self._options, "include_dashboard": False, "num_gpus": 1}
        self._cluster: Any = Cluster(initialize_head=True, head_node_args=head)
        self.workers: list[Any] = []
        """The nodes beside the head."""
        for _ in range(nodes - 1):
            self.add_node()

    @property
    def address(self) -> str:
        """HOST:PORT of the head."""
        return self._cluster.address

    def add_node(self) -> None:
        """Start another node; on a busy machine Ray may give up, and is asked again.

        Raises:
            RuntimeError: It gave up each time.
        """
        for _ in range(STARTS):
            try:
                self.workers.append(self._cluster.add_node(**self._options))
            except Exception:  # noqa: BLE001 - Ray raises no narrower class
                continue
            return
        raise RuntimeError(f"No node could be started in {STARTS} attempts.")

    def kill_node(self) -> None:
        """Kill a node that is not the head, with all that runs on it."""
        self._cluster.remove_node(self.workers.pop(), allow_graceful=False)

    def close(self) -> None:
        """End all nodes."""
        self._cluster.shutdown()

    def processes(self) -> dict[str, list[int]]:
        """Numbers of the processes of an evaluation on it: actors, workers and policies."""
        found: dict[str, list[int]] = {}
        for pid in _descendants(os.getpid()):
            with suppress(OSError):
                words = Path(f"/proc/{pid}/cmdline").read_bytes()
                if words.startswith(b"ray::RemoteProcess"):
                    found.setdefault("actor", []).append(pid)
                elif b"runners.worker import main" in words:
                    found.setdefault("worker", []).append(pid)
                elif b"runners.policy_process import main" in words:
                    found.setdefault("policy", []).append(pid)
        return found


def set_environment() -> None:
    """Set what nodes and their users need; Ray reads it when it is first imported."""
    os.environ.update(ENVIRONMENT)
    os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(16))


@contextmanager
def local_cluster(nodes: int = 2, cpus: int = 2) -> Iterator[LocalCluster]:
    """A cluster as long as the block lasts; see `LocalCluster`."""
    cluster = LocalCluster(nodes, cpus)
    try:
        yield cluster
    finally:
        cluster.close()


def _descendants(pid: int) -> Sequence[int]:
    parents: dict[int, int] = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):
            words = (entry / "stat").read_text().rpartition(")")[2].split()
            parents[int(entry.name)] = int(words[1])
    found = {pid}
    while (
        more := {child for child, parent in parents.items() if parent in found} - found
    ):
        found |= more
    return sorted(found - {pid})
