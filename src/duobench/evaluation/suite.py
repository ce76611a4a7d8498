"""From names to what is evaluated: the tasks of a run, and the seed of each episode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from duobench.evaluation.run import Run, TaskInfo
from duobench.randomness import episode_seed
from duobench.tasks import catalog


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """One episode to run."""

    task: TaskInfo
    """The task."""
    episode: int
    """Index of the episode in the suite."""

    @property
    def seed(self) -> int:
        """Seed of the reset: a pure function of (task, suite version, episode)."""
        return episode_seed(self.task.id, self.episode)


def describe(references: Sequence[str]) -> tuple[TaskInfo, ...]:
    """Look tasks up.

    Args:
        references: Task ids or `module:ATTRIBUTE`; none means every task of the benchmark.

    Returns:
        One description a task, in the order asked for.

    Raises:
        UnknownNameError: If a task does not exist.
    """
    infos = []
    for reference in references or catalog.names():
        task = catalog.get(reference)
        infos.append(
            TaskInfo(
                reference=reference,
                id=task.id,
                title=task.title,
                category=str(task.category),
                stages=tuple(stage.name for stage in task.stages),
                horizon=task.horizon,
            )
        )
    return tuple(infos)


def trials(run: Run) -> list[Trial]:
    """Every episode of every task of a run, task by task."""
    return [
        Trial(task=task, episode=episode) for task in run.tasks for episode in run.episode_indices
    ]
