"""The benchmark's tasks: one module each, found by name, loaded when asked for.

Importing this module loads no task and no physics, so that ids can be registered at no cost.
"""

from __future__ import annotations

from functools import lru_cache
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
    return _named(task) if isinstance(task, str) else task


@lru_cache(maxsize=64)
def _named(name: str) -> Task:
    if ":" not in name and name not in NAMES:
        raise UnknownNameError("task", name, NAMES)

    from duobench.tasks.task import Task

    path = name if ":" in name else f"duobench.tasks.{name}:TASK"
    return load(path, "task", lambda value: isinstance(value, Task))
