"""Kill an evaluation on a Ray cluster at random moments: what comes out must be what comes out.

    python -m dev.benchmarks.ray_kills --kills 30 --seed 0

Killed are actors, the processes of simulators and policies, whole nodes, and the process that
writes, which is started again. It needs the extra ray.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from dev.benchmarks.kills import ROOT, contents, has_ended, report
from dev.benchmarks.ray_cluster import LocalCluster, local_cluster

TASKS, EPISODES, WORKERS = ("carry_pot", "bin_sort"), 3, 2
POLICIES = ("random", "dev.benchmarks.kills:Wanders")
LONGEST_PAUSE_S = 6.0
"""Seconds from one kill to the next, at most."""
TIMEOUT_S = 600.0
"""Seconds that a run may take, and that its first processes may take."""
MOST_IN_A_RUN = 6
"""Kills in one run."""
NODE_SHARE = 0.1
"""How many of the kills hit a whole node, which takes long to start again."""
MAX_FAILURES = 20
"""How often it may end with an error, as it does where kills have hit one episode three times."""


def start(policy: str, out: Path, address: str = "") -> subprocess.Popen[bytes]:
    """Start an evaluation, on a cluster if there is an address."""
    executor = ("--executor", "ray", "--address", address) if address else ()
    folders = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    with (out.parent / f"{out.name}.log").open("ab") as log:
        return subprocess.Popen(
            [
                sys.executable,
                "-m",
                "duobench",
                "eval",
                "--policy",
                policy,
                "--tasks",
                *TASKS,
                "--videos",
                "0",
                "--episodes",
                str(EPISODES),
                "--workers",
                str(WORKERS),
                "--out",
                str(out),
                *executor,
            ],
            env={**os.environ, "PYTHONPATH": folders},
            stdout=log,
            stderr=log,
        )


def finish(policy: str, out: Path, address: str = "") -> None:
    """Play a run to its end.

    Raises:
        AssertionError: It fails.
    """
    if status := start(policy, out, address).wait(TIMEOUT_S):
        raise AssertionError(f"{out}: it ends with exit code {status}.")


def disturb_one(
    policy: str, out: Path, cluster: LocalCluster, generator: random.Random, kills: int
) -> Counter[str]:
    """Play a run to its end and kill meanwhile, at most so often; who was killed."""
    counts = Counter[str]()
    failures = 0
    process = start(policy, out, cluster.address)
    while (status := process.poll()) != 0:
        if status is not None:
            failures += status > 0
            if failures > MAX_FAILURES:
                raise AssertionError(f"{out}: it ends with exit code {status}.")
            process = start(policy, out, cluster.address)
        if counts.total() == kills:
            process.wait(TIMEOUT_S)
            continue
        deadline = time.monotonic() + TIMEOUT_S
        while process.poll() is None and "worker" not in cluster.processes():
            if time.monotonic() > deadline:
                raise AssertionError(f"{out}: no worker within {TIMEOUT_S:g} s.")
            time.sleep(0.1)
        time.sleep(generator.uniform(0.0, LONGEST_PAUSE_S))
        if process.poll() is not None:
            continue
        kind = _kill(process.pid, cluster, generator, spares_policies=has_ended(out))
        counts[kind] += 1
        if kind == "driver":
            process.wait()
    return counts


def _kill(
    driver: int, cluster: LocalCluster, generator: random.Random, *, spares_policies: bool
) -> str:
    """Kill something that takes part; what it was."""
    if generator.random() < NODE_SHARE:
        cluster.kill_node()
        cluster.add_node()
        return "node"
    targets = {**cluster.processes(), "driver": [driver]}
    if spares_policies:
        targets.pop("policy", None)
    kind = generator.choice(sorted(targets))
    with suppress(ProcessLookupError):
        os.kill(generator.choice(targets[kind]), signal.SIGKILL)
    return kind


def disturb(
    folder: Path, cluster: LocalCluster, kills: int, seed: int
) -> Iterator[tuple[str, Counter[str]]]:
    """Kill that often, in as many runs as that takes.

    Args:
        folder: An empty folder.
        cluster: Where the runs are played.
        kills: How often.
        seed: Seed of the moments and of whom it hits.

    Yields:
        The policy of a run that was disturbed, and who was killed in it.

    Raises:
        AssertionError: Its results are not those of a run without Ray.
    """
    generator, left, number = random.Random(seed), kills, 0
    expected: dict[str, dict[str, bytes]] = {}
    while left:
        policy = POLICIES[number % len(POLICIES)]
        if policy not in expected:
            finish(policy, folder / f"expected-{number}")
            expected[policy] = contents(folder / f"expected-{number}")
        out = folder / str(number)
        most = min(left, MOST_IN_A_RUN)
        counts = disturb_one(policy, out, cluster, generator, most)
        left -= counts.total()
        if contents(out) != expected[policy]:
            raise AssertionError(f"{out}: results differ after {dict(counts)}")
        yield policy, counts
        number += 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, local_cluster() as there:
        report(disturb(Path(name), there, asked.kills, asked.seed))
