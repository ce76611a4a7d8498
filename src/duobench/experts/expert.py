"""A script as a policy: reads the privileged state, acts through the same 16 numbers as any."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from duobench.errors import PolicyError
from duobench.experts.motion import Arms, Script
from duobench.sim.kinematics import Kinematics
from duobench.sim.simulation import Simulation


class Expert:
    """Runs one script an episode; when the script has ended, it holds still."""

    def __init__(self, simulation: Simulation, script: Callable[[Arms], Script]) -> None:
        """Bind a script to the simulation it reads.

        Args:
            simulation: The simulation of the environment that it acts in.
            script: The task's script.
        """
        self._simulation = simulation
        self._script = script
        self._kinematics = Kinematics()
        self._arms: Arms | None = None
        self._running: Script | None = None

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        """Begin an episode; the simulation must already be reset."""
        self._arms = Arms(self._simulation, self._kinematics)
        self._running = self._script(self._arms)

    def act(self, observation: object) -> NDArray[np.float64]:  # noqa: ARG002
        """The next action as a chunk (1, 16)."""
        if self._arms is None:
            raise PolicyError("An expert needs reset before act.")
        if self._running is not None:
            try:
                next(self._running)
            except StopIteration:
                self._running = None
        return self._arms.action()[None]
