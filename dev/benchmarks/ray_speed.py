"""How much longer a run takes on a local Ray cluster than with as many workers and without it.

    python -m dev.benchmarks.ray_speed

Two simulator actors play against two workers, in turn, the same episodes; starting is left aside:
counted is the time from the first finished episode to the last one. The exit status says whether
the bar is met. It needs the extra ray.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from dev.benchmarks.ray_cluster import LocalCluster, local_cluster
from duobench.evaluation.runners.evaluate import evaluate
from duobench.evaluation.runners.ray_process import Cluster
from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Suite, find_tasks

WORKERS = 2
BAR = 1.10
"""Most time on the cluster, as a share of that without."""
LEFT_ASIDE = 2 * WORKERS
"""Episodes at the beginning, in which processes start and models are compiled."""


class _Times:
    """Notes when episodes are finished."""

    def __init__(self) -> None:
        self.times: list[float] = []

    def on_run_start(self, run: Run, finished: Sequence[EpisodeRecord]) -> None:
        """Nothing is finished yet."""

    def on_episode(self, played: EpisodeRecord) -> None:  # noqa: ARG002 - the protocol's
        """One is."""
        self.times.append(time.monotonic())

    @property
    def seconds(self) -> float:
        """From the last episode that is left aside to the last one."""
        return self.times[-1] - self.times[LEFT_ASIDE - 1]


def measure(policy: str, suite: Suite, folder: Path, cluster: LocalCluster | None) -> float:
    """Seconds that a run takes, without its start."""
    times = _Times()
    where = Cluster(address=cluster.address) if cluster else None
    evaluate(policy, suite, RunFolder(folder), workers=WORKERS, observers=[times], cluster=where)
    return times.seconds


def main() -> None:
    """Measure, and print the ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--policy", default="expert")
    parser.add_argument("--task", default="bin_sort")
    asked = parser.parse_args()
    suite = Suite(tasks=find_tasks((asked.task,)), episodes=asked.episodes + LEFT_ASIDE)
    ratios = []
    with tempfile.TemporaryDirectory() as name, local_cluster(1) as cluster:
        for number in range(asked.rounds):
            ours = measure(asked.policy, suite, Path(name, f"workers-{number}"), None)
            theirs = measure(asked.policy, suite, Path(name, f"ray-{number}"), cluster)
            ratios.append(theirs / ours)
            print(f"workers {ours:.1f} s, Ray {theirs:.1f} s, ratio {ratios[-1]:.3f}", flush=True)
    ratio = statistics.median(ratios)
    print(json.dumps({"ratio": round(ratio, 3), "bar": BAR, "rounds": len(ratios)}))
    sys.exit(ratio > BAR)


if __name__ == "__main__":
    main()
