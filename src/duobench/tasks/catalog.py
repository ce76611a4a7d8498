"""The benchmark's tasks: one module each, known by name, loaded on first use.

Importing this module loads no task and no physics, so that ids can be registered at no cost.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from duobench.core.errors import (
    ForeignTaskError,
    OptionError,
    UnknownNameError,
    check_known,
)
from duobench.core.references import load

if TYPE_CHECKING:
    from duobench.tasks.task import Task

HORIZONS: Mapping[str, int] = {
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
"""Horizon of every task, by id in the order of the paper's categories: what Gymnasium has to know
before a task is loaded. The tasks say the same."""


_ENV_ID = re.compile(r"(?:duobench:)?duobench/([^:]+)-v1")
"""The id of an environment, as Gymnasium takes it, with or without the module that registers it."""


def names() -> tuple[str, ...]:
    """Every task id, in the order of the paper's categories."""
    return tuple(HORIZONS)


def plain(name: str) -> str:
    """A task's id or import path; of the id of its environment, the part that names the task."""
    found = _ENV_ID.fullmatch(name)
    return found[1] if found else name


def id_of(name: str) -> str:
    """The id of the task that a name stands for, whether or not there is such a task.

    Raises:
        UnknownNameError, ImportPathError: Nothing is at an import path.
    """
    return get(name).id if ":" in plain(name) else plain(name)


def reference(task: Task | str) -> str:
    """Id or import path by which a task was given; empty for a task object."""
    return plain(task) if isinstance(task, str) else ""


def import_paths(names: Iterable[str]) -> tuple[str, ...]:
    """Select the names that are import paths."""
    return tuple(name for name in names if ":" in plain(name))


def check(name: str) -> None:
    """Reject a name that is neither a task's id nor an import path, without loading anything."""
    name = plain(name)
    if name == "all":
        raise UnknownNameError(
            "No task is named 'all'. Where several can be given, none means all."
        )
    if "," in name:
        separate = " ".join(re.split(r"[,\s]+", name))
        raise UnknownNameError(
            f"{name!r} is one word; separate names by spaces: {separate}."
        )
    if ":" not in name:
        check_known("task", name, HORIZONS)


def trusted(
    task: str,
    reference: str,
    *,
    import_tasks: bool,
) -> str:
    """Reference of a task that data of others name: its id, or its import path if allowed.

    Raises:
        ForeignTaskError: The task is from outside the benchmark and may not be imported.
        UnknownNameError: The task is from outside the benchmark and its import path is unknown.
    """
    if task in HORIZONS:
        return task
    if ":" not in reference:
        raise UnknownNameError(
            f"The task {task!r} is not in the benchmark, and nothing says where it is: the "
            "environment was made from the task itself, not from its import path."
        )
    if not import_tasks:
        raise ForeignTaskError(f"The task {reference!r} is not in the benchmark.")
    return reference


def get(task: Task | str) -> Task:
    """A task.

    Args:
        task: Its id, also as the id of its environment; its import path `module:attribute` where
            it lives elsewhere; or itself.

    Raises:
        UnknownNameError: There is no such task.
        ImportPathError: The module of an import path is missing or raises an error.
        OptionError: At an import path is a task of one's own with the id of one of the benchmark.
    """
    if not isinstance(task, str):
        return task
    task = plain(task)
    check(task)

    from duobench.tasks.task import Task

    path = task if ":" in task else f"duobench.tasks.{task}:TASK"
    found: Task = load(path, "task", lambda value: isinstance(value, Task))
    if ":" in task and found.id in HORIZONS and found is not get(found.id):
        raise OptionError(
            f"The benchmark has a task {found.id!r}, and {task} is another one; give it an id of "
            "its own."
        )
    return found
