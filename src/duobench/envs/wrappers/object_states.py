"""Object states: where all objects are, as numbers in the observation."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import gymnasium as gym
import numpy as np

from duobench.envs.duo_env import Observation, base_of
from duobench.envs.wrappers.base import ObservingWrapper
from duobench.tasks.object_state import ENVIRONMENT_STATE, LARGEST

if TYPE_CHECKING:
    from duobench.envs.sim_env import SimEnv


class ObjectStates(ObservingWrapper):
    """Adds `environment_state` to the observation: the numbers (n,) of `Task.object_state`.

    They are privileged: read from the simulation, not seen. `object_state_names` says what each is.
    """

    def __init__(self, env: gym.Env) -> None:
        """Wrap an environment.

        Args:
            env: A `SimEnv`, wrapped or not.

        Raises:
            TypeError: There is no simulation inside.
        """
        base = base_of(env)
        if not hasattr(base, "simulation"):  # asked without loading one
            raise TypeError(
                "Object states are read from a simulation, and there is none in a "
                f"{type(base).__name__}."
            )
        self._simulation = cast("SimEnv", base).simulation
        self._state = base.definition.object_state
        numbers = gym.spaces.Box(-LARGEST, LARGEST, (len(self._state.names),), dtype=np.float32)
        super().__init__(env, ENVIRONMENT_STATE, numbers)

    @property
    def object_state_names(self) -> tuple[str, ...]:
        """What each number of `environment_state` is."""
        return self._state.names

    def observe(self, observation: Observation) -> Observation:
        """The observation with the numbers of the current state."""
        return {**observation, ENVIRONMENT_STATE: self._state.read(self._simulation)}
