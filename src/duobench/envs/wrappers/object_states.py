"""Object states: where all objects are, as numbers in the observation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np

from duobench.envs.duo_env import Observation, ResetOptions, Start, Transition
from duobench.envs.episode_state import EpisodeState
from duobench.envs.wrappers.base import DuoWrapper
from duobench.tasks.object_state import ENVIRONMENT_STATE, LARGEST

if TYPE_CHECKING:
    from duobench.envs.sim_env import SimEnv


class ObjectStates(DuoWrapper):
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
        super().__init__(env)
        if not hasattr(self.base, "simulation"):  # asked without loading one
            raise TypeError(
                "Object states are read from a simulation, and there is none in a "
                f"{type(self.base).__name__}."
            )
        self._simulation = cast("SimEnv", self.base).simulation
        self._state = self.base.definition.object_state
        inner = env.observation_space
        if not isinstance(inner, gym.spaces.Dict):
            raise TypeError(f"Object states are added to a Dict of observations, got {inner}.")
        numbers = gym.spaces.Box(-LARGEST, LARGEST, (len(self._state.names),), dtype=np.float32)
        self.observation_space = gym.spaces.Dict({**inner.spaces, ENVIRONMENT_STATE: numbers})

    @property
    def object_state_names(self) -> tuple[str, ...]:
        """What each number of `environment_state` is."""
        return self._state.names

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        return self._seen(observation), info

    def step(self, action: Any) -> Transition:
        """Advance one step of the wrapped environment, then read the numbers."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._seen(observation), float(reward), terminated, truncated, info

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state."""
        observation, info = super().restore_state(state)
        return self._seen(observation), info

    def _seen(self, observation: Observation) -> Observation:
        return {**observation, ENVIRONMENT_STATE: self._state.read(self._simulation)}
