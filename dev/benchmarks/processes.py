"""What it costs that a policy has a process of its own, and what a second worker brings."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from dev.benchmarks.measure import Measurement
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.runners.evaluate import evaluate
from duobench.policy import PolicyMetadata
from duobench.results.folder import RunFolder
from duobench.results.suite import Suite, find_tasks

TASK = "bin_sort"
CHUNK = 30
EPISODES = 40
REPEATS = 5
LOG = "DUOBENCH_BENCHMARK_STARTS"
"""Environment variable: file in which the policy notes when its episodes begin."""


class Free:
    """Costs nothing, and sees three cameras."""

    metadata = PolicyMetadata(name="free", image_size=(224, 224), horizon=CHUNK)

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - the protocol's signature
        """Note the time, which all processes of a machine share."""
        with Path(os.environ[LOG]).open("a", encoding="ascii") as log:
            print(time.monotonic(), file=log)

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        """A chunk (30, 16) of where the arms are."""
        return np.tile(observation["agent_pos"], (CHUNK, 1))


def measure() -> Iterator[Measurement]:
    """Measure evaluations without a process of the policy, with one, and with two workers.

    The three take turns, so that what else the machine does falls on all of them; ratios are
    medians.
    """
    taken: dict[int, list[float]] = {workers: [] for workers in (0, 1, 2)}
    for _ in range(REPEATS):
        for workers, times in taken.items():
            times.append(_seconds(workers))
    yield Measurement(what="episode with one worker", value=median(taken[1]), unit="s")
    apart = median(one / none for none, one in zip(taken[0], taken[1], strict=True))
    what = "policy in a process of its own, against none (`--workers 0`)"
    yield Measurement(what=what, value=apart, at_most=1.05)
    second = median(one / two for one, two in zip(taken[1], taken[2], strict=True))
    yield Measurement(what="two workers against one", value=second, at_least=1.8)


def _seconds(workers: int) -> float:
    """Seconds from one episode to the next, while all workers play."""
    suite = Suite(tasks=find_tasks([TASK]), episodes=EPISODES)
    choice = PolicyChoice.parse(f"{__name__}:{Free.__name__}")
    with TemporaryDirectory() as folder:
        log = Path(folder) / "starts"
        os.environ[LOG] = str(log)
        evaluate(choice, suite, RunFolder(Path(folder) / "run"), workers=workers)
        starts = sorted(map(float, log.read_text().splitlines()))
    steady = starts[-(EPISODES - max(workers, 1)) :]
    return (steady[-1] - steady[0]) / (len(steady) - 1)
