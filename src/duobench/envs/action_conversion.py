"""An action of one mode as one of another, for the same targets of both arms."""

from typing import Any

import gymnasium as gym
import numpy as np

from duobench.core.types import SIDES, Array, DuoCommand
from duobench.envs.action_modes import CARTESIAN, CARTESIAN_RELATIVE, JOINT
from duobench.envs.action_wrappers import joint_targets
from duobench.envs.duo_env import base_of
from duobench.envs.spaces import opening_slots
from duobench.world.kinematics.inverse import Kinematics


class ActionConverter:
    """Turns actions of absolute joints or tool poses into those that an environment takes.

    Tool poses become joint targets by the step of inverse kinematics that `CartesianActions` makes,
    so the arms go the same way in either mode.

    Args:
        env: The environment.
        given: Mode of the actions that are turned, "joint" or "cartesian".
    """

    def __init__(
        self,
        env: gym.Env,
        given: str,
    ) -> None:
        self._env = env
        self._given = given
        self._wanted: str = env.get_wrapper_attr("action_mode")
        self._kinematics = Kinematics(base_of(env).backend.robot)

    def __call__(self, action: Array) -> Array:
        """The action in the environment's mode, at this moment."""
        if self._given == self._wanted:
            return action
        if self._wanted not in (CARTESIAN.name, CARTESIAN_RELATIVE.name):
            return self._joints(action)
        poses = action if self._given == CARTESIAN.name else self._poses(action)
        if self._wanted == CARTESIAN.name:
            return poses
        relative: Any = self._env.get_wrapper_attr("action_to")
        return relative(poses)

    def _joints(self, action: Array) -> Array:
        """An absolute action in a mode of joints."""
        command = base_of(self._env).backend.last_command
        is_pose = self._given == CARTESIAN.name
        targets = (
            joint_targets(self._kinematics, command.joints[None], action[None])[0]
            if is_pose
            else action
        )
        if self._wanted == JOINT.name:
            return targets
        start = command.flat
        start[opening_slots(len(start))] = 0.0
        return targets - start

    def _poses(self, action: Array) -> Array:
        """An action of absolute joints as absolute tool poses."""
        command = DuoCommand.from_flat(action)
        poses = self._kinematics.forward(command.joints)
        return np.concatenate(
            [[*poses[side].tquat, command.openings[side.index]] for side in SIDES]
        )
