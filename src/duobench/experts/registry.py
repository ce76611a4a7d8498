"""From a task to its expert."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from duobench.errors import PolicyError
from duobench.experts.expert import Expert
from duobench.sim.simulation import Simulation

if TYPE_CHECKING:
    from collections.abc import Callable

    from duobench.experts.motion import Arms, Script


def find_script(task_id: str) -> Callable[[Arms], Script]:
    """The script of a task, from the module of its name.

    Raises:
        PolicyError: The task has none.
    """
    module = f"duobench.experts.{task_id}"
    if find_spec(module) is None:
        raise PolicyError(
            f"Task {task_id!r} has no scripted expert; write src/duobench/experts/{task_id}.py "
            "with a function `script(arms)`, or pass a script of your own to `Expert`."
        )
    return import_module(module).script


def make_expert(task_id: str, simulation: Simulation) -> Expert:
    """The expert of a task, bound to the simulation that it reads.

    Args:
        task_id: Id of a task of the benchmark.
        simulation: That of the environment the expert acts in: `env.unwrapped.simulation`.

    Raises:
        PolicyError: The task has no expert.
    """
    return Expert(simulation, find_script(task_id))
