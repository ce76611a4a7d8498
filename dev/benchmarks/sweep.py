"""Play every task with a policy on seeds 0 to n-1, and count the stages that were reached.

`python -m dev.benchmarks.sweep --policy expert --seeds 100` counts the experts' successes; with
`hold`, `zero`, `open_close` or `random` it shows what can be had for nothing. `--policy
expert:human --split train` counts them as demonstrations are made. Beside the successes it prints
how smoothly experts move, and with `--replays 10` how many of the first episodes of a job their
tool poses alone win once more. `--kernels` compares processors instead: see
`dev.benchmarks.kernels`.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

import duobench
from dev.benchmarks import kernels
from dev.benchmarks.motion import Intended, Smoothness, replay_as_poses
from dev.benchmarks.steps import Steps
from duobench.core.randomness import EVAL, SPLITS
from duobench.core.types import OPENING_SLOTS
from duobench.evaluation import policies
from duobench.evaluation.rollouts import rollout
from duobench.policy import BASELINES, HoldPolicy
from duobench.tasks import catalog
from duobench.tasks.experts.variety import VARIETIES
from duobench.world.robot.gripper import DEFAULT_GRIPPER

OPEN_CLOSE = "open_close"
EXPERTS = ("expert", *(f"expert:{name}" for name in VARIETIES))
POLICIES = (*EXPERTS, "blind", *BASELINES, OPEN_CLOSE)
HALF_PERIOD = 30
"""Control steps for which grippers stay closed, or open."""
SEEDS_A_JOB = 10
WIDTH = 140
KERNEL_SEEDS = (0, 1, 2, 3)
"""Seeds of each task on which processors are compared."""


class OpenClosePolicy(HoldPolicy):
    """Closes and opens both grippers in the air, one second each."""

    def reset(self, instruction: str, seed: int) -> None:
        """Begin with closing."""
        super().reset(instruction, seed)
        self._steps = 0

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        """One action (1, 16)."""
        action = super().act(observation).copy()
        action[:, OPENING_SLOTS] = (self._steps // HALF_PERIOD) % 2
        self._steps += 1
        return action


@dataclass(frozen=True, kw_only=True, slots=True)
class Job:
    """Some seeds of one task."""

    task: str
    policy: str
    seeds: tuple[int, ...]
    replays: int = 0
    """How many of the seeds are replayed as tool poses, if they are won."""
    split: str = EVAL
    horizon: int | None = None
    """Control steps an episode lasts at most; None is the task's."""
    gripper: str = DEFAULT_GRIPPER


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """How one episode ended."""

    task: str
    seed: int
    stage: int
    success: bool
    steps: int
    state_hash: str
    """Of the whole state after the last step."""
    smoothness: Smoothness
    """Of the joint targets that the policy intended."""
    replayed: bool | None = None
    """Whether its tool poses alone won once more; None if they were not played."""


def play(job: Job) -> list[Outcome]:
    """Play one job in this process."""
    env = duobench.make(
        job.task,
        cameras=False,
        split=job.split,
        horizon=job.horizon,
        gripper=job.gripper,
    )
    policy = Intended(
        OpenClosePolicy()
        if job.policy == OPEN_CLOSE
        else policies.source(job.policy).bind(env)
    )
    outcomes, steps = [], Steps()
    for number, seed in enumerate(job.seeds):
        rollout(env, policy, seed=seed, watchers=[steps])
        last = steps[-1]
        is_replayed = number < job.replays and last.info["success"]
        outcomes.append(
            Outcome(
                task=job.task,
                seed=seed,
                stage=last.info["stage"],
                success=last.info["success"],
                steps=last.number,
                state_hash=env.get_wrapper_attr("state_hash")(),
                smoothness=Smoothness.of(np.array(policy.commands)),
                replayed=replay_as_poses(
                    job.task, seed, policy.commands, split=job.split
                )
                if is_replayed
                else None,
            )
        )
    env.close()
    return outcomes


def main() -> None:
    """Play what the arguments name, and print one row a task."""
    parser = argparse.ArgumentParser(
        prog="python -m dev.benchmarks.sweep", description=__doc__
    )
    parser.add_argument("--policy", choices=POLICIES, default="expert")
    parser.add_argument(
        "--tasks", nargs="+", choices=catalog.names(), default=catalog.names()
    )
    parser.add_argument("--gripper", default=DEFAULT_GRIPPER)
    parser.add_argument("--split", choices=SPLITS, default=EVAL)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument(
        "--horizon", type=int, help="control steps an episode lasts at most"
    )
    parser.add_argument(
        "--replays", type=int, default=0, help="replays as tool poses a task"
    )
    parser.add_argument(
        "--hashes", type=Path, help="file to write hashes of last states to"
    )
    parser.add_argument(
        "--kernels", action="store_true", help="compare processors instead"
    )
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    if arguments.kernels:
        Console(width=WIDTH).print(_kernels(arguments.tasks))
        return
    end = arguments.first + arguments.seeds
    starts = range(arguments.first, end, SEEDS_A_JOB)
    jobs = [
        Job(
            task=task,
            policy=arguments.policy,
            split=arguments.split,
            horizon=arguments.horizon,
            gripper=arguments.gripper,
            seeds=tuple(range(start, min(start + SEEDS_A_JOB, end))),
            replays=max(0, arguments.first + arguments.replays - start),
        )
        for task, start in product(arguments.tasks, starts)
    ]
    with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
        done = track(
            pool.imap(play, jobs), description=arguments.policy, total=len(jobs)
        )
        outcomes = [outcome for batch in done for outcome in batch]
    if arguments.hashes:
        hashes = {f"{o.task} {o.seed}": [o.stage, o.state_hash] for o in outcomes}
        arguments.hashes.write_text(json.dumps(hashes, indent=0), encoding="utf-8")
    title = f"{arguments.policy}, split {arguments.split}, from seed {arguments.first}"
    Console(width=WIDTH).print(_table(outcomes, arguments.tasks, title))


def _table(outcomes: list[Outcome], tasks: list[str], title: str) -> Table:
    table = Table(title=title)
    for column in (
        "task",
        "won",
        "last stages",
        "steps mean / max",
        "of horizon",
        "reversal, jump, margin",
        "as poses",
        "failures",
    ):
        table.add_column(column, no_wrap=True)
    for task in tasks:
        mine = [outcome for outcome in outcomes if outcome.task == task]
        won = [outcome.steps for outcome in mine if outcome.success]
        replayed = [
            outcome.replayed for outcome in mine if outcome.replayed is not None
        ]
        stages = Counter(outcome.stage for outcome in mine)
        failures = [f"{o.seed}: {o.stage}" for o in mine if won and not o.success]
        table.add_row(
            task,
            f"{len(won)}/{len(mine)}",
            " ".join(f"{stage}: {count}" for stage, count in sorted(stages.items())),
            f"{np.mean(won):.0f} / {max(won)}" if won else "",
            f"{max(won) / catalog.get(task).horizon:.0%}" if won else "",
            str(reduce(Smoothness.worst, [outcome.smoothness for outcome in mine])),
            f"{sum(replayed)}/{len(replayed)}" if replayed else "",
            ", ".join(failures[:6]) + (" ..." if len(failures) > 6 else ""),  # noqa: PLR2004
        )
    return table


def _kernels(tasks: list[str]) -> Table:
    """What each variant of `dev.benchmarks.kernels` has in common with the first one."""
    names = kernels.playable(kernels.VARIANTS)
    found = kernels.compare(names, tasks, KERNEL_SEEDS, experts=True)
    first = found[names[0]]
    table = Table(
        title=f"Equal to {names[0]}, seeds {min(KERNEL_SEEDS)} to {max(KERNEL_SEEDS)}"
    )
    kinds = ("models", "resets", "replays", "experts")
    for column in ("variant", *kinds, "other experts"):
        table.add_column(column)
    for name, mine in found.items():
        same = {
            kind: [mine[kind][key] == first[kind][key] for key in first[kind]]
            for kind in kinds
        }
        others = [
            key
            for key in first["experts"]
            if mine["experts"][key] != first["experts"][key]
        ]
        counts = [f"{sum(equal)}/{len(equal)}" for equal in same.values()]
        table.add_row(name, *counts, ", ".join(others))
    return table


if __name__ == "__main__":
    main()
