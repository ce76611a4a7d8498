"""Train and evaluate the baselines of this folder on every task of an export, and print a table.

    python table.py exports --out runs/baselines --demonstrations 50 --seeds 3 --workers 2

The same command goes on where it was stopped: networks and episodes that are there stay.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import mlp
import numpy as np
from demonstrations import UNTIL, Demonstrations

from duobench.results.folder import RunFolder
from duobench.results.scores import Score, wilson_interval
from duobench.results.suite import Suite, TaskInfo, find_tasks
from duobench.runners import evaluate
from duobench.tasks import catalog


def train(export: Path, episodes: int, until: str, job: tuple[Path, int]) -> str:
    """Train one network, unless it is there; what is written is whole."""
    path, seed = job
    if path.exists():
        return f"{path} is there"
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".part.npz")
    data = Demonstrations.load(export / path.parent.name, episodes, until)
    error = mlp.train(data, unfinished, seed)
    unfinished.replace(path)
    return f"{path}: error {error:.3f}"


def play(
    policy: str, checkpoint: Path, task: TaskInfo, out: Path, asked: argparse.Namespace
) -> Score:
    """Evaluate one policy on one task, or read how it went."""
    os.environ["CHECKPOINT"] = str(checkpoint.absolute())
    os.environ["EPISODES"], os.environ["UNTIL"] = str(asked.demonstrations), asked.until
    suite = Suite(tasks=(task,), episodes=asked.episodes)
    results = evaluate(policy, suite, RunFolder(out), workers=asked.workers)
    stages = "  ".join(f"{n}:{k}" for n, k in enumerate(results.tasks[0].last_stage_counts) if k)
    print(
        f"{out}: {results.overall.successes} of {asked.episodes}; last stages {stages}", flush=True
    )
    return results.overall


def row(task: str, nearest: Score, scores: Sequence[Score]) -> str:
    """One row of the table; the interval is that of one seed's episodes at the mean of all."""
    rates = [100 * score.successes / score.episodes for score in scores]
    trials = scores[0].episodes
    low, high = wilson_interval(round(np.mean(rates) / 100 * trials), trials)
    progress = np.mean([score.mean_final_progress for score in scores])
    return (
        f"| `{task}` | {100 * nearest.successes / nearest.episodes:.0f} | {np.mean(rates):.0f} "
        f"({100 * low:.0f} to {100 * high:.0f}) | {', '.join(f'{rate:.0f}' for rate in rates)} "
        f"| {progress:.2f} |"
    )


def table(asked: argparse.Namespace) -> Iterator[str]:
    """Train and play everything, and give the rows of the table."""
    tasks = find_tasks(asked.tasks)
    folder = asked.out / f"{asked.demonstrations}"
    jobs = [
        (folder / "networks" / task.id / f"{seed}.npz", seed)
        for task in tasks
        for seed in range(asked.seeds)
    ]
    with ProcessPoolExecutor(max(asked.workers, 1)) as pool:
        for line in pool.map(partial(train, asked.export, asked.demonstrations, asked.until), jobs):
            print(line, flush=True)
    yield "| task | nearest state | network (95 %) | by seed | progress |"
    yield "| --- | ---: | ---: | ---: | ---: |"
    for task in tasks:
        runs = folder / "runs" / task.id
        near = play("nearest:Nearest", asked.export / task.id, task, runs / "nearest", asked)
        scores = [
            play("mlp:MLP", path, task, runs / f"mlp-{seed}", asked)
            for path, seed in jobs
            if path.parent.name == task.id
        ]
        yield row(task.id, near, scores)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("export", type=Path, help="folder with a data set for each task")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tasks", nargs="+", default=catalog.names())
    parser.add_argument("--demonstrations", type=int, default=50)
    parser.add_argument("--until", choices=UNTIL, default="end", help="where they are cut")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    print("\n".join(table(parser.parse_args())))
