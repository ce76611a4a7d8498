"""The benchmark's tasks: one module each, found by name, loaded when asked for.

Importing this module loads no task and no physics, so that ids can be registered at no cost.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from duobench.errors import DuoBenchError, UnknownNameError

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


@lru_cache(maxsize=64)
def get(name: str) -> Task:
    """A task by id, or by import path "module:ATTRIBUTE" for one that lives elsewhere.

    Raises:
        UnknownNameError: No such task, module or attribute.
        DuoBenchError: What the path names is no task.
    """
    if ":" in name:
        return _imported(name)
    if name not in NAMES:
        raise UnknownNameError("task", name, NAMES)
    return import_module(f"duobench.tasks.{name}").TASK


def _imported(path: str) -> Task:
    from duobench.tasks.task import Task

    module_name, attribute = path.split(":", 1)
    try:
        found = find_spec(module_name)
    except (ImportError, ValueError):
        found = None
    if found is None:
        raise DuoBenchError(
            f"No module {module_name!r} for task {path!r}; is its folder on PYTHONPATH?"
        )
    module = import_module(module_name)
    task = getattr(module, attribute, None)
    if not isinstance(task, Task):
        tasks = [key for key, value in vars(module).items() if isinstance(value, Task)]
        raise UnknownNameError(f"task in module {module_name}", attribute, tasks)
    return task
