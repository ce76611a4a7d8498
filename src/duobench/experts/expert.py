"""A script as a policy: reads the privileged state, acts through the same 16 numbers as any."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from duobench.errors import PolicyError
from duobench.experts.motion import Arms, Script
from duobench.experts.variety import NONE, Variety, VarietySample
from duobench.sim.kinematics import Kinematics
from duobench.sim.simulation import Simulation
from duobench.types import DuoCommand


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
        self._kinematics = Kinematics()
        self._arms: Arms | None = None
        self._running: Script | None = None
        self.intended_action: NDArray[np.float32] | None = None
        """The last action (16,) without the noise in what was executed; None before the first."""

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        """Begin an episode; the simulation must already be reset."""
        sample = VarietySample(self._variety, self._task_id, seed)
        self._arms = Arms(self._simulation, self._kinematics, sample)
        self.intended_action = None
        self._running = self._script(self._arms)

    def act(self, observation: object) -> NDArray[np.float64]:  # noqa: ARG002
        """The next action, as it shall be executed, in a chunk (1, 16)."""
        if self._arms is None:
            raise PolicyError("An expert needs reset before act.")
        if self._running is not None:
            try:
                next(self._running)
            except StopIteration:
                self._running = None
        intended, executed = self._next_actions(self._arms)
        self.intended_action = intended.astype(np.float32)
        return executed[None]

    def _next_actions(self, arms: Arms) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The intended and the executed action (16,), both within what the arms obey."""
        action = arms.action()
        if not self._variety.noise:
            return action, action
        duo = self._simulation.duo
        joints = arms.joints + arms.variety.disturbance(arms.freedom)
        noisy = DuoCommand(joints=joints, openings=arms.openings).flat
        last = duo.command().flat
        return duo.limits.clip(action, last), duo.limits.clip(noisy, last)
