"""Runs whose outcomes are given stage by stage, for comparisons."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from duobench.policy import PolicyMetadata
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
    look: str = "default",
    **changes: Any,
) -> str:
    """A run folder whose episodes ended with these stages, task by task.

    Args:
        path: The folder.
        stages: Last stage of each episode, by id of the task.
        policy: Name of the policy.
        first_episode: Index of the first one.
        object_state: Whether the policy is privileged.
        look: Look of the suite.
        changes: Fields of the records and, where it has them, of the run.
    """
    of_run = {"config": "config", "suite_version": "version"}
    run = sample_run(
        tasks=tuple(BY_ID[name] for name in stages),
        episodes=max(1, *map(len, stages.values())),
        first_episode=first_episode,
        look=look,
        policy=policy,
        metadata=PolicyMetadata(name=policy, version="1", object_state=object_state),
        **{of_run[name]: value for name, value in changes.items() if name in of_run},
    )
    records = [
        sample_record(
            task,
            first_episode + index,
            tuple((n + 1) * task.horizon // (task.max_stage + 1) for n in range(stage)),
            policy=policy,
            **changes,
        )
        for task in run.suite.tasks
        for index, stage in enumerate(stages[task.id])
    ]
    return str(sample_folder(path, run, records).path)
