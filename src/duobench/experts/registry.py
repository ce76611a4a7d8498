"""From a task to its expert."""

from __future__ import annotations

from collections.abc import Callable

from duobench.errors import DuoBenchError, PolicyError
from duobench.experts.expert import Expert
from duobench.experts.motion import Arms, Script
from duobench.experts.variety import NONE, Variety
from duobench.references import load
from duobench.sim.simulation import Simulation
from duobench.tasks import catalog
from duobench.tasks.task import Task


def find_script(task: Task | str) -> Callable[[Arms], Script]:
    """The script of a task's expert: what `Task.expert` names.

    Args:
        task: The task, its id, or its import path `module:attribute`.

    Raises:
        PolicyError: The task has none, or it cannot be imported.
    """
    task = catalog.get(task)
    if task.expert is None:
        raise PolicyError(
            f"Task {task.id!r} has no scripted expert. Write a function `script(arms)`, and set "
            "the task's `expert` to its import path, such as my_module:script."
        )
    try:
        return load(task.expert, "script", callable)
    except DuoBenchError as error:
        raise PolicyError(f"The expert of task {task.id!r}: {error}") from error


def make_expert(task: Task | str, simulation: Simulation, variety: Variety = NONE) -> Expert:
    """The expert of a task, bound to the simulation that it reads.

    Args:
        task: The task, its id, or its import path `module:attribute`.
        simulation: That of the environment the expert acts in: `env.unwrapped.simulation`.
        variety: How its episodes differ from the plain script.

    Raises:
        PolicyError: The task has no expert.
    """
    task = catalog.get(task)
    return Expert(simulation, find_script(task), variety=variety, task_id=task.id)
