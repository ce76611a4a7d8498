"""A script as a policy: reads the privileged state, acts through the same 16 numbers as any."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import DuoBenchError, PolicyError
from duobench.core.references import load
from duobench.core.types import Array, DuoCommand
from duobench.tasks import catalog
from duobench.tasks.experts.motion import Arms, Script
from duobench.tasks.experts.variety import NONE, Variety, VarietySample
from duobench.tasks.task import Task
from duobench.world.kinematics.inverse import Kinematics

if TYPE_CHECKING:
    from duobench.world.sim.simulation import Simulation


class Expert:
    """Runs one script an episode; when the script has ended, it holds still.

    With a variety, the executed action is the intended one with noise, so that the expert shows how
    to come back from where it did not mean to be.
    """

    def __init__(
        self,
        simulation: Simulation,
        script: Callable[[Arms], Script],
        *,
        variety: Variety = NONE,
        task_id: str = "",
    ) -> None:
        """Bind a script to the simulation it reads.

        Args:
            simulation: The simulation of the environment that it acts in.
            script: The task's script.
            variety: How episodes differ from the plain script.
            task_id: Id of the task, from which and the seed an episode's differences follow.
        """
        self._simulation = simulation
        self._script = script
        self._variety = variety
        self._task_id = task_id
        self._kinematics = Kinematics(simulation.robot)
        self._latency = 0
        self._episode: tuple[Arms, Script] | None = None
        self.intended_action: NDArray[np.float32] | None = None
        """The last action (16,) without the noise in what was executed; None before the first."""

    def expect_latency(self, steps: int) -> None:
        """Expect that an action is executed so many control steps after its answer."""
        self._latency = steps

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        """Begin an episode; the simulation must already be reset."""
        sample = VarietySample(self._variety, self._task_id, seed)
        arms = Arms(self._simulation, self._kinematics, sample, self._latency)
        self._episode = arms, self._script(arms)
        self.intended_action = None

    def act(self, observation: object) -> Array:  # noqa: ARG002
        """The next action, as it shall be executed, in a chunk (1, 16)."""
        if self._episode is None:
            raise PolicyError("An expert needs reset before act.")
        arms, running = self._episode
        next(running, None)
        intended = executed = arms.action()
        if self._variety.noise:
            duo = self._simulation.duo
            joints = arms.joints + arms.variety.disturbance(arms.freedom)
            noisy = DuoCommand(joints=joints, openings=arms.openings).flat
            executed = duo.clipped(noisy)
        self.intended_action = intended.astype(np.float32)
        return executed[None]


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
