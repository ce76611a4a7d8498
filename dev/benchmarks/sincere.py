"""Count how often what is done is refused, over sincere ways of doing it that are not the experts'.

`python -m dev.benchmarks.sincere --episodes 30` takes, for every task, ways at random from
`tests.ways` (height, tilt and depth of grasps, places, heights of release, order, arms, slow
motion, trembling, halts, slips and second grasps), plays each in a layout of its own without a time
limit, and compares the stage that was reached with what a person would call done.
"""

from __future__ import annotations

import argparse
import multiprocessing
from dataclasses import dataclass
from itertools import product

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from duobench.tasks import catalog
from tests.task_harness import TaskHarness
from tests.ways.play import Judgement, play, ways_of

EPISODES_A_JOB = 5
WIDTH = 120
BAR = 0.01
"""Largest share of what is done that may be refused."""
MAX_TOLD = 4


@dataclass(frozen=True, kw_only=True, slots=True)
class Job:
    """Some episodes of one task."""

    task: str
    seeds: range


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """One episode."""

    task: str
    seed: int
    way: str
    judgement: Judgement

    @property
    def refused(self) -> bool:
        """Whether the task was done and does not count."""
        return self.judgement.done and not self.counts

    @property
    def counts(self) -> bool:
        """Whether the last stage was reached."""
        return self.judgement.stage == catalog.get(self.task).max_stage


def run(job: Job) -> list[Outcome]:
    """Play one job in this process."""
    bench, sample = TaskHarness(catalog.get(job.task)), ways_of(job.task).sample
    outcomes = []
    for seed in job.seeds:
        way = sample(np.random.default_rng((seed, 0x776179)))
        judgement = play(bench, way, seed)
        outcomes.append(
            Outcome(task=job.task, seed=seed, way=str(way), judgement=judgement)
        )
    return outcomes


def main() -> int:
    """Play what the arguments name, and print one row a task."""
    parser = argparse.ArgumentParser(
        prog="python -m dev.benchmarks.sincere", description=__doc__
    )
    parser.add_argument(
        "--tasks", nargs="+", choices=catalog.names(), default=catalog.names()
    )
    parser.add_argument("--episodes", type=int, default=30)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    end = arguments.first + arguments.episodes
    jobs = [
        Job(task=task, seeds=range(start, min(start + EPISODES_A_JOB, end)))
        for task, start in product(
            arguments.tasks, range(arguments.first, end, EPISODES_A_JOB)
        )
    ]
    with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
        found = track(pool.imap(run, jobs), description="Playing", total=len(jobs))
        outcomes = [outcome for batch in found for outcome in batch]
    table = Table(title="Sincere ways, taken at random")
    for column in (
        "task",
        "episodes",
        "done",
        "refused",
        "counts, not done",
        "refused ways",
    ):
        table.add_column(column, no_wrap=column != "refused ways")
    for task in arguments.tasks:
        mine = [outcome for outcome in outcomes if outcome.task == task]
        refused = [outcome for outcome in mine if outcome.refused]
        told = [
            f"{o.seed}: {o.way} (stage {o.judgement.stage})" for o in refused[:MAX_TOLD]
        ]
        odd = [o for o in mine if o.counts and not o.judgement.done]
        table.add_row(
            task,
            str(len(mine)),
            str(sum(outcome.judgement.done for outcome in mine)),
            str(len(refused)),
            str(len(odd)) + (f" (seed {odd[0].seed})" if odd else ""),
            "\n".join(told),
        )
    Console(width=WIDTH).print(table)
    done = sum(outcome.judgement.done for outcome in outcomes)
    refused = sum(outcome.refused for outcome in outcomes)
    print(f"{refused} of {done} refused though done")
    return int(refused > BAR * done)


if __name__ == "__main__":
    raise SystemExit(main())
