"""The benchmark's tasks: one module each, known by name, loaded on first use.

Importing this module loads no task and no physics, so that ids can be registered at no cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from duobench.errors import check_known
from duobench.references import load

if TYPE_CHECKING:
    from duobench.tasks.task import Task

HORIZONS: Mapping[str, int] = MappingProxyType(
    {
        "hinge_chest": 441,
        "spring_door": 807,
        "pour_marbles": 442,
        "ball_maze": 350,
        "carry_pot": 450,
        "block_balance": 766,
        "join_blocks": 829,
        "transfer_cube": 441,
        "transfer_gate": 523,
        "transfer_reorient": 505,
        "bin_sort": 216,
    }
)
"""Horizon of every task, by id in the order of the paper's categories: what Gymnasium has to know
before a task is loaded. The tasks say the same."""


def names() -> tuple[str, ...]:
    """Every task id, in the order of the paper's categories."""
    return tuple(HORIZONS)


def get(task: Task | str) -> Task:
    """A task.

    Args:
        task: Its id, its import path `module:attribute` where it lives elsewhere, or itself.

    Raises:
        UnknownNameError: There is no such task.
        ImportPathError: The module of an import path is missing or raises an error.
    """
    if not isinstance(task, str):
        return task
    if ":" not in task:
        check_known("task", task, HORIZONS)

    from duobench.tasks.task import Task

    path = task if ":" in task else f"duobench.tasks.{task}:TASK"
    return load(path, "task", lambda value: isinstance(value, Task))
