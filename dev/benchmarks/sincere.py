"""Count how often what is done is refused, over sincere ways of doing it that are not the experts'.

`python -m dev.benchmarks.sincere --episodes 30` takes, for every task, ways at random from
`tests.ways` (height, tilt and depth of grasps, places, heights of release, order, arms, slow
motion, trembling, halts, slips and second grasps), plays each in a layout of its own without a time
limit, and compares the stage that was reached with what a person would call done. With
`--adversaries` it plays all of these instead, each in as many layouts, at half the speed where it
failed, and counts who is paid.
"""

from __future__ import annotations

import argparse
import multiprocessing
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from duobench.tasks import catalog
from duobench.world.robot.frames import robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER
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
    gripper: str = DEFAULT_GRIPPER
    adversaries: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """One episode."""

    task: str
    seed: int
    way: str
    judgement: Judgement
    gets: int | None = None
    """The stage that it may reach, if it is an adversary."""

    @property
    def paid(self) -> bool:
        """Whether it did its deed, and reached more than it may."""
        most = self.judgement.stage if self.gets is None else self.gets
        return self.judgement.done and self.judgement.stage > most

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
    bench = TaskHarness(catalog.get(job.task), robot_with(job.gripper))
    ways, outcomes = ways_of(job.task), []
    for number in job.seeds:
        if job.adversaries:
            played = [
                (name, w, w.seed + number) for name, w in ways.ADVERSARIES.items()
            ]
        else:
            way = ways.sample(np.random.default_rng((number, 0x776179)))
            played = [(str(way), way, number)]
        for name, way, seed in played:
            judgement = play(bench, way, seed)
            if job.adversaries and not judgement.done:
                judgement = play(bench, replace(way, slowness=2), seed)
            outcome = Outcome(
                task=job.task,
                seed=seed,
                way=name,
                judgement=judgement,
                gets=way.gets,
            )
            outcomes.append(outcome)
    return outcomes


def main() -> int:
    """Play what the arguments name, and print one row a task."""
    parser = argparse.ArgumentParser(
        prog="python -m dev.benchmarks.sincere", description=__doc__
    )
    parser.add_argument(
        "--tasks", nargs="+", choices=catalog.names(), default=catalog.names()
    )
    parser.add_argument("--gripper", default=DEFAULT_GRIPPER)
    parser.add_argument("--adversaries", action="store_true")
    parser.add_argument("--episodes", type=int, default=30)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    end = arguments.first + arguments.episodes
    jobs = [
        Job(
            task=task,
            seeds=range(start, min(start + EPISODES_A_JOB, end)),
            gripper=arguments.gripper,
            adversaries=arguments.adversaries,
        )
        for task, start in product(
            arguments.tasks, range(arguments.first, end, EPISODES_A_JOB)
        )
    ]
    with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
        found = track(pool.imap(run, jobs), description="Playing", total=len(jobs))
        outcomes = [outcome for batch in found for outcome in batch]
    if arguments.adversaries:
        paid = [f"{o.task}, {o.seed}: {o.way}" for o in outcomes if o.paid]
        done = sum(outcome.judgement.done for outcome in outcomes)
        print("\n".join([*paid, f"{len(paid)} paid of {done} adversaries that did it"]))
        return int(bool(paid))
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
