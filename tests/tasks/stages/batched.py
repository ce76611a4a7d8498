"""Episodes that one judge judged, judged again side by side by the judge of many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from duobench.core.types import Array
from duobench.tasks.stages.batch import ProgressBatch
from duobench.tasks.stages.progress import ProgressState
from duobench.tasks.task import Task
from duobench.world.sim.simulation import Simulation
from duobench.world.sim.thread_batch import ThreadBatch


@dataclass(frozen=True, kw_only=True, slots=True)
class Judged:
    """An episode: its states, and what the judge of one knew after each; the first is unjudged."""

    variants: dict[str, str]
    physics: Sequence[Array]
    progress: Sequence[ProgressState]


def mismatches(task: Task, episodes: Sequence[Judged]) -> list[str]:
    """Steps at which the judge of many knows something else."""
    batch = ThreadBatch(Simulation(task.props), len(episodes), 1)
    judge = ProgressBatch(task.stages, batch)
    for number, episode in enumerate(episodes):
        judge.set_state(number, episode.progress[0])
    found: list[str] = []
    for step in range(1, max(len(episode.physics) for episode in episodes)):
        running = [n for n, episode in enumerate(episodes) if step < len(episode.physics)]
        here = [episodes[n] for n in running]
        batch.load(np.array(running), [e.variants for e in here], [e.physics[step] for e in here])
        batch.copy_contacts(np.array(running))
        batch.contacts.update(batch.centres)
        judge.update(np.isin(np.arange(len(episodes)), running))
        for n in running:
            knows, expected = judge.get_state(n), episodes[n].progress[step]
            if knows != expected:
                found.append(f"episode {n}, step {step}: {knows} instead of {expected}")
    return found
