"""The benchmark's tasks: one module each, found by name, loaded when asked for.

Importing this module loads no task and no physics, so that ids can be registered at no cost.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from duobench.errors import UnknownNameError
from duobench.references import load

if TYPE_CHECKING:
    from duobench.tasks.task import Task

NAMES = (
    "hinge_chest",
    "spring_door",
    "pour_marbles",
    "ball_maze",
    "carry_pot",
    "block_balance",
    "join_blocks",
    "transfer_cube",
    "transfer_gate",
    "transfer_reorient",
    "bin_sort",
)
"""Task ids in the order of the paper's categories."""


def names() -> tuple[str, ...]:
    """Every task id, in the order of the paper's categories."""
    return NAMES


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
    if ":" not in task and task not in NAMES:
        raise UnknownNameError("task", task, NAMES)

    from duobench.tasks.task import Task

    path = task if ":" in task else f"duobench.tasks.{task}:TASK"
    return load(path, "task", lambda value: isinstance(value, Task))
