"""Relative actions: displacements from what was last commanded."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from duobench.envs import spaces
from duobench.envs.action_modes import CARTESIAN_RELATIVE, JOINT_RELATIVE
from duobench.envs.duo_env import ResetOptions, Start, Transition
from duobench.envs.episode_state import EpisodeState, required
from duobench.envs.wrappers.base import ActionModeWrapper
from duobench.kinematics.inverse import Kinematics
from duobench.spatial import SE3, product, rotation_by
from duobench.types import SIDES, Array, Side

MAX_TRACKING_LAG = 0.02
MAX_TRACKING_LAG_ROTATION = 0.1
"""How far (metres, radians) the arms may stay behind the poses that displacements add up to."""
MAX_DISPLACEMENT = 1e6
"""Larger numbers of a displacement, which no arm can follow, are clipped so that their squares stay
finite."""


class RelativeJointActions(ActionModeWrapper):
    """Joint displacements.

    An action is 16 numbers in the order of a joint action: each joint's displacement from its last
    commanded target in radians; the openings stay absolute. A target that leaves a joint's range
    is clipped there, and the next displacement starts from the clipped one.
    """

    mode = JOINT_RELATIVE

    def hold_action(self) -> Array:
        """The action (16,) that leaves the command as it is: openings alone are not zero."""
        action = self.base.backend.last_command.flat
        slots = spaces.opening_slots(len(action))
        openings = action[slots].copy()
        action[:] = 0.0
        action[slots] = openings
        return action

    def step(self, action: Any) -> Transition:
        """Advance one control step.

        Raises:
            ActionError: See `check_action`. Nothing was moved.
        """
        start = self.base.backend.last_command.flat
        start[spaces.opening_slots(len(start))] = 0.0
        return self.env.step(self.check_action(action) + start)


class RelativeCartesianActions(ActionModeWrapper):
    """Tool displacements.

    An action is 14 numbers, left then right: translation dx dy dz (metres) and rotation vector
    rx ry rz (radians) of the tool centre point, both along the axes of the table frame, then the
    absolute gripper opening. The rotation turns the tool about its tool centre point.

    Displacements add up without drift: each starts from the pose that the last one led to. Where
    the arms cannot follow (joint ranges, velocity limits), the next one starts from where they are
    commanded to be, so that pushing against a limit stores nothing up.
    """

    mode = CARTESIAN_RELATIVE

    def __init__(self, env: gym.Env) -> None:
        """Wrap an environment with `CartesianActions` inside.

        Raises:
            AttributeError: It takes no Cartesian actions.
        """
        super().__init__(env)
        self._kinematics: Kinematics = env.get_wrapper_attr("kinematics")
        self._targets: dict[Side, SE3] = {}

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode; the first displacement starts at home."""
        result = self.env.reset(seed=seed, options=options)
        self._targets = {}
        return result

    def save_state(self) -> EpisodeState:
        """The state of the wrapped environment, with what displacements have added up to."""
        return replace(super().save_state(), tool_targets=tuple(self._targets.items()))

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, and from what displacements had added up to.

        Raises:
            StateError: The state was saved without relative Cartesian actions.
        """
        targets = required(state.tool_targets, "relative Cartesian action mode")
        result = super().restore_state(state)
        self._targets = dict(targets)
        return result

    def step(self, action: Any) -> Transition:
        """Advance one control step.

        Raises:
            ActionError: See `check_action`. Nothing was moved.
        """
        rows = self.check_action(action).reshape(len(SIDES), -1)
        starts = self._starts()
        targets = {side: _displaced(starts[side], rows[side.index]) for side in SIDES}
        poses = [[*targets[side].tquat, rows[side.index, -1]] for side in SIDES]
        result = self.env.step(np.ravel(poses))
        self._targets = targets
        return result

    def hold_action(self) -> Array:
        """The action (14,) that leaves the command as it is: openings alone are not zero."""
        openings = self.base.backend.last_command.openings
        return np.ravel([[*np.zeros(6), openings[side.index]] for side in SIDES])

    def _starts(self) -> dict[Side, SE3]:
        """Where this displacement starts for each side."""
        commanded = self._kinematics.forward(self.base.backend.last_command.joints)
        starts = {}
        for side, pose in commanded.items():
            target = self._targets.get(side, pose)
            length, angle = target.distance(pose)
            starts[side] = (
                target
                if length <= MAX_TRACKING_LAG and angle <= MAX_TRACKING_LAG_ROTATION
                else pose
            )
        return starts


def _displaced(pose: SE3, displacement: Array) -> SE3:
    """A pose shifted and turned by dx dy dz rx ry rz along the table's axes."""
    displacement = np.clip(displacement[:6], -MAX_DISPLACEMENT, MAX_DISPLACEMENT)
    rotation = product(rotation_by(displacement[3:]), pose.rotation)
    return SE3(rotation, pose.translation + displacement[:3])
