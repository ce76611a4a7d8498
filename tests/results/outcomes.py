"""Runs whose outcomes are given stage by stage, for comparisons."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from duobench.policy import PolicyMetadata
from duobench.results.suite import TaskInfo
from tests.results.samples import LIFT, SORT, TURN, sample_folder, sample_record, sample_run

Stages = Mapping[str, Sequence[int]]
POT = replace(LIFT, id="carry_pot", title="Carry-Pot")
"""A task that has the id of one of the paper."""
BY_ID = {task.id: task for task in (LIFT, SORT, TURN, POT)}


def play(
    path: Path,
    stages: Stages,
    policy: str = "mine",
    first_episode: int = 0,
    object_state: bool = False,
    **changes: Any,
) -> str:
    """A run folder whose episodes ended with these stages, task by task.

    Args:
        path: The folder.
        stages: Last stage of each episode, by id of the task.
        policy: Name of the policy.
        first_episode: Index of the first one.
        object_state: Whether the policy is privileged.
        changes: Fields of the records and, where it has them, of the run.
    """
    tasks = tuple(BY_ID[name] for name in stages)
    of_run = {name: changes[name] for name in ("config", "look") if name in changes}
    changes.pop("look", None)
    if "suite_version" in changes:
        of_run["version"] = changes["suite_version"]
    run = sample_run(
        tasks=tasks,
        episodes=max(map(len, stages.values())),
        first_episode=first_episode,
        policy=policy,
        metadata=PolicyMetadata(name=policy, version="1", object_state=object_state),
        **of_run,
    )
    records = [
        sample_record(task, first_episode + index, _steps(task, stage), policy=policy, **changes)
        for task in tasks
        for index, stage in enumerate(stages[task.id])
    ]
    return str(sample_folder(path, run, records).path)


def _steps(task: TaskInfo, stage: int) -> tuple[int, ...]:
    return tuple((number + 1) * task.horizon // (task.max_stage + 1) for number in range(stage))
