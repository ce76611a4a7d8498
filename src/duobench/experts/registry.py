"""From a task to its expert."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from duobench.errors import PolicyError
from duobench.experts.expert import Expert
from duobench.experts.variety import NONE, Variety
from duobench.sim.simulation import Simulation

if TYPE_CHECKING:
    from collections.abc import Callable

    from duobench.experts.motion import Arms, Script


def find_script(task_id: str, reference: str = "") -> Callable[[Arms], Script]:
    """The script of a task: from the module that defines it, else from the benchmark's experts.

    Args:
        task_id: Id of the task.
        reference: `module:ATTRIBUTE` under which the task was asked for, if it was.

    Raises:
        PolicyError: The task has none.
    """
    own, is_path, _ = reference.partition(":")
    modules = [own] if is_path else []
    if find_spec(ours := f"duobench.experts.{task_id}") is not None:
        modules.append(ours)
    for module in modules:
        if script := getattr(import_module(module), "script", None):
            return script
    raise PolicyError(
        f"Task {task_id!r} has no scripted expert; write a function `script(arms)` into the module "
        "that defines the task, and ask for the task as module:ATTRIBUTE."
    )


def make_expert(
    task_id: str, simulation: Simulation, reference: str = "", *, variety: Variety = NONE
) -> Expert:
    """The expert of a task, bound to the simulation that it reads.

    Args:
        task_id: Id of the task.
        simulation: That of the environment the expert acts in: `env.unwrapped.simulation`.
        reference: `module:ATTRIBUTE` under which the task was asked for, if it was.
        variety: How its episodes differ from the plain script.

    Raises:
        PolicyError: The task has no expert.
    """
    script = find_script(task_id, reference)
    return Expert(simulation, script, variety=variety, task_id=task_id)
