"""Cartesian actions: tool poses instead of joint targets, solved by inverse kinematics."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from duobench.envs.action_modes import CARTESIAN
from duobench.envs.duo_env import Transition
from duobench.envs.wrappers.base import ActionModeWrapper
from duobench.errors import ActionError
from duobench.kinematics.inverse import Kinematics
from duobench.spatial import SE3, length
from duobench.types import ARM_JOINTS, SIDE_SIZE, SIDES, Array, DuoCommand

MIN_NORM = 1e-3
"""A quaternion shorter than this names no orientation."""


class CartesianActions(ActionModeWrapper):
    """Absolute tool poses.

    An action is 16 numbers, left then right: tool centre point in the table frame x y z (metres)
    and qx qy qz qw (normalized here), then the gripper opening. Each control step brings the arms
    towards the poses by one step of inverse kinematics from the last commanded joints, within
    joint ranges and velocity limits; a pose that is far away is reached after several steps.
    """

    mode = CARTESIAN

    def __init__(self, env: gym.Env) -> None:
        """Wrap an environment that takes joint targets."""
        super().__init__(env)
        self.kinematics = Kinematics()
        """The solver, for wrappers outside this one."""

    def check_action(self, action: Any) -> Array:
        """The action as 16 float64 numbers, without executing it.

        Raises:
            ActionError: It has another shape, holds NaN or infinity, or a quaternion is zero.
        """
        numbers = super().check_action(action)
        for side in SIDES:
            start = side.index * SIDE_SIZE
            quaternion = numbers[start + 3 : start + 7]
            if length(quaternion) < MIN_NORM:
                raise ActionError(
                    f"The {side} quaternion (qx qy qz qw) is {quaternion.tolist()}, which is no "
                    "orientation; send a quaternion of length one."
                )
        return numbers

    def hold_action(self) -> Array:
        """The action (16,) that leaves the commanded tool poses and openings as they are."""
        command = self.base.backend.last_command
        poses = self.kinematics.forward(command.joints)
        rows = [[*poses[side].tquat, command.openings[side.index]] for side in SIDES]
        return np.ravel(rows)

    def step(self, action: Any) -> Transition:
        """Advance one control step towards the poses.

        Raises:
            ActionError: See `check_action`. Nothing was moved.
        """
        rows = self.check_action(action).reshape(len(SIDES), SIDE_SIZE)
        targets = {side: SE3.from_tquat(rows[side.index, :ARM_JOINTS]) for side in SIDES}
        last = self.base.backend.last_command
        joints = self.kinematics.step(last.joints, targets)
        command = DuoCommand(joints=joints, openings=rows[:, ARM_JOINTS])
        return self.env.step(command.flat)
