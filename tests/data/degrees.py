"""An action mode that the package does not have: joint targets in degrees."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from duobench.backend import DuoLimits
from duobench.envs import DuoWrapper, spaces
from duobench.envs.action_modes import ActionMode
from duobench.envs.duo_env import Transition
from duobench.types import FLAT_SIZE, OPENING_SLOTS, Array

FACTORS = np.full(FLAT_SIZE, 180 / np.pi)
FACTORS[list(OPENING_SLOTS)] = 1.0


def _space(limits: DuoLimits) -> gym.spaces.Box:
    return spaces.box(limits.low * FACTORS, limits.high * FACTORS)


DEGREES = ActionMode(
    name="joint_degrees",
    names=tuple(f"{name}_degrees" for name in spaces.JOINT_NAMES),
    space=_space,
    wrappers=("tests.data.degrees:DegreeActions",),
)


class DegreeActions(DuoWrapper):
    """Takes joint targets in degrees."""

    action_mode = DEGREES.name

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self.action_space = DEGREES.space(self.base.backend.limits)

    def check_action(self, action: Any) -> Array:
        return spaces.checked_action(action, DEGREES.names)

    def step(self, action: Any) -> Transition:
        return self.env.step(self.check_action(action) / FACTORS)
