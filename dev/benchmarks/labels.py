"""Replay what an export makes of demonstrations, without looking, and count what succeeds again.

`python -m dev.benchmarks.labels demos --episodes 5` plays the labels of the first successful
episodes
of each task in the action mode that they are meant for: joint targets as a reference, tool poses,
and changes of tool poses, each as the actor intended them and as they were sent. So it says which
tasks survive that the elbows are no part of an action, and which the noise of a demonstration.
"""

from __future__ import annotations

import argparse
import multiprocessing
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

import duobench
from duobench.data import ActionSource, DataSet, Recording
from duobench.data.lerobot.actions import labels_of
from duobench.envs.action_labels import LABELS
from duobench.envs.config import LAYOUT

SOURCES = (ActionSource.INTENDED, ActionSource.SENT)
KINDS = tuple(product(LABELS, SOURCES))
HOLD_STEPS = 5
"""Control steps for which a replay holds the last action: other elbows may lag by a step."""
WIDTH = 140


@dataclass(frozen=True, kw_only=True, slots=True)
class Job:
    """Replays of one episode."""

    task: str
    path: Path


def successes(job: Job) -> list[bool]:
    """Whether the episode succeeds once more, for each of `KINDS`."""
    recording = Recording.read(job.path)
    return [replay(recording, mode, source) for mode, source in KINDS]


def replay(recording: Recording, mode: str, source: ActionSource) -> bool:
    """Whether the labels of an episode alone succeed from its layout on.

    Args:
        recording: The episode.
        mode: Action mode that the labels are meant for.
        source: Which of the recorded numbers they are made of.
    """
    rows, _ = labels_of(recording, mode, source)
    actions = LABELS[mode].to_actions(rows.astype(np.float32))
    env = duobench.make(recording.info.task, cameras=False, action_mode=mode)
    _, info = env.reset(options={LAYOUT: recording.info.layout})
    for action in [*actions, *_held(actions[-1], mode)]:
        *_, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            break
    env.close()
    return bool(info["success"])


def _held(last: np.ndarray, mode: str) -> list[np.ndarray]:
    """Actions that hold what the last one led to."""
    if mode.endswith("_relative"):
        sides = last.reshape(2, -1).copy()
        sides[:, :-1] = 0.0
        last = sides.ravel()
    return [last] * HOLD_STEPS


def main() -> None:
    """Replay what the arguments name, and print one row a task."""
    parser = argparse.ArgumentParser(
        prog="python -m dev.benchmarks.labels", description=__doc__
    )
    parser.add_argument("data", type=Path, help="folder of a data set")
    parser.add_argument("--episodes", type=int, default=5, help="episodes of each task")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    data = DataSet.open(arguments.data, create=False)
    jobs = []
    for task in data.tasks:
        infos = (
            (path, Recording.read_info(path).outcome) for path in data.episodes(task)
        )
        won = [path for path, outcome in infos if outcome and outcome.success]
        jobs += [Job(task=task, path=path) for path in won[: arguments.episodes]]
    with multiprocessing.get_context("spawn").Pool(arguments.workers) as pool:
        done = list(track(pool.imap(successes, jobs), "Replaying", total=len(jobs)))
    table = Table(title="Successes of replayed labels")
    table.add_column("task", no_wrap=True)
    for mode, source in KINDS:
        table.add_column(f"{mode}\n{source}", justify="right", no_wrap=True)
    for task in data.tasks:
        mine = [row for job, row in zip(jobs, done, strict=True) if job.task == task]
        counts = [f"{sum(column)}/{len(column)}" for column in zip(*mine, strict=True)]
        table.add_row(task, *counts)
    Console(width=WIDTH).print(table)


if __name__ == "__main__":
    main()
