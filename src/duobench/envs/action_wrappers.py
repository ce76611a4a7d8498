"""Other forms of actions: binary grippers, displacements, tool poses, chunks of several."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np

from duobench.core.errors import ActionError
from duobench.core.spatial import (
    SE3,
    length,
    product,
    rotation_by,
    rotation_vector,
)
from duobench.core.types import (
    ARM_JOINTS,
    SIDE_SIZE,
    SIDES,
    Array,
    Side,
)
from duobench.envs import spaces
from duobench.envs.action_modes import CARTESIAN, CARTESIAN_RELATIVE, JOINT_RELATIVE
from duobench.envs.duo_env import (
    ActionModeWrapper,
    DuoWrapper,
    ResetOptions,
    Start,
    Transition,
)
from duobench.envs.episode_state import EpisodeState, required
from duobench.envs.execution import execute
from duobench.envs.spaces import opening_slots
from duobench.world.kinematics.inverse import Kinematics

THRESHOLD = 0.5
"""Openings from here on mean open."""


class BinaryGripper(DuoWrapper):
    """Rounds both openings of an action, in any action mode: 1 from one half on, otherwise 0."""

    def check_action(self, action: Any) -> Array:
        """The action, in any mode, as float64 numbers with each opening 0 or 1."""
        numbers = self.env.get_wrapper_attr("check_action")(action).copy()
        slots = opening_slots(len(numbers))
        numbers[slots] = numbers[slots] >= THRESHOLD
        return numbers

    def step(self, action: Any) -> Transition:
        """Advance one control step."""
        return self.env.step(self.check_action(action))


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
        command = self.base.backend.last_command
        return replace(command, joints=np.zeros_like(command.joints)).flat

    def step(self, action: Any) -> Transition:
        """Advance one control step."""
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

    Raises:
        AttributeError: It takes no Cartesian actions.
    """

    mode = CARTESIAN_RELATIVE

    def __init__(self, env: gym.Env) -> None:
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
        """Continue from a saved state, and from what displacements had added up to."""
        targets = required(state.tool_targets, "relative Cartesian action mode")
        result = super().restore_state(state)
        self._targets = dict(targets)
        return result

    def step(self, action: Any) -> Transition:
        """Advance one control step."""
        poses, targets = displaced_poses(
            self._kinematics,
            self.base.backend.last_command.joints,
            self._targets,
            self.check_action(action),
        )
        result = self.env.step(poses)
        self._targets = targets
        return result

    def action_to(self, poses: Array) -> Array:
        """The action (14,) that leads the tools to poses and openings, as of `CartesianActions`."""
        rows = poses.reshape(len(SIDES), SIDE_SIZE)
        starts = _starts(
            self._kinematics, self.base.backend.last_command.joints, self._targets
        )
        numbers = []
        for side, start in starts.items():
            goal = SE3.from_tquat(rows[side.index, :ARM_JOINTS])
            turn = rotation_vector(product(goal.rotation, start.rotation.T))
            numbers += [goal.translation - start.translation, turn]
            numbers.append(rows[side.index, ARM_JOINTS:])
        return np.concatenate(numbers)

    def hold_action(self) -> Array:
        """The action (14,) that leaves the command as it is: openings alone are not zero."""
        openings = self.base.backend.last_command.openings
        return np.ravel([[*np.zeros(6), openings[side.index]] for side in SIDES])


def displaced_poses(
    kinematics: Kinematics,
    joints: Array,
    before: Mapping[Side, SE3],
    displacements: Array,
) -> tuple[Array, dict[Side, SE3]]:
    """Cartesian action that displacements of both tools mean, and what they now add up to.

    Args:
        kinematics: The solver.
        joints: The commanded joints (2, 7).
        before: Poses that earlier displacements added up to, if there were any.
        displacements: A relative Cartesian action (14,).
    """
    rows = displacements.reshape(len(SIDES), -1)
    targets = {
        side: _displaced(start, rows[side.index])
        for side, start in _starts(kinematics, joints, before).items()
    }
    poses = [[*targets[side].tquat, rows[side.index, -1]] for side in SIDES]
    return np.ravel(poses), targets


def _starts(
    kinematics: Kinematics,
    joints: Array,
    before: Mapping[Side, SE3],
) -> dict[Side, SE3]:
    """Poses that displacements start from: where the arms lag, what they are commanded to."""
    starts = {}
    for side, commanded in kinematics.forward(joints).items():
        start = before.get(side, commanded)
        lag, angle = start.distance(commanded)
        is_near = lag <= MAX_TRACKING_LAG and angle <= MAX_TRACKING_LAG_ROTATION
        starts[side] = start if is_near else commanded
    return starts


def _displaced(pose: SE3, displacement: Array) -> SE3:
    """A pose shifted and turned by dx dy dz rx ry rz along the table's axes."""
    displacement = np.clip(displacement[:6], -MAX_DISPLACEMENT, MAX_DISPLACEMENT)
    rotation = product(rotation_by(displacement[3:]), pose.rotation)
    return SE3(rotation, pose.translation + displacement[:3])


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
        super().__init__(env)
        self.kinematics = Kinematics(self.base.backend.robot)
        """The solver, for wrappers outside this one."""

    def check_action(self, action: Any) -> Array:
        """The action as 16 float64 numbers; an error also where a quaternion is zero."""
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
        return np.ravel(
            [[*poses[side].tquat, command.openings[side.index]] for side in SIDES]
        )

    def step(self, action: Any) -> Transition:
        """Advance one control step towards the poses."""
        poses = self.check_action(action)
        joints = self.base.backend.last_command.joints
        return self.env.step(
            joint_targets(self.kinematics, joints[None], poses[None])[0]
        )


def joint_targets(kinematics: Kinematics, joints: Array, poses: Array) -> Array:
    """Joint actions (n, 16) of a step each from commanded joints (n, 2, 7) towards poses (n, 16).

    The poses are Cartesian actions, and their openings those of the joint actions.
    """
    actions = poses.reshape(-1, len(SIDES), SIDE_SIZE).copy()
    actions[..., :ARM_JOINTS] = kinematics.step_all(joints, actions[..., :ARM_JOINTS])
    return actions.reshape(poses.shape)


class ActionChunks(DuoWrapper):
    """Executes n actions one after the other, and stops early when the episode ends.

    The observation and info are those after the last executed action. The reward is the sum, so
    that returns do not depend on chunks; `info["rewards"]` (n,) holds the single ones, zero where
    no action was executed, `info["executed"]` counts the executed actions, and `info["clipped"]`
    says what was clipped in any of them.

    Args:
        env: A `DuoEnv`, wrapped or not; cameras belong outside, then they render once a chunk.
        length: Actions in one chunk.

    Raises:
        ValueError: The length is not positive.
    """

    def __init__(self, env: gym.Env, length: int) -> None:
        if length < 1:
            raise ValueError(f"A chunk has at least one action, got {length}.")
        super().__init__(env, length=length)
        self._length = length
        single = env.action_space
        if not isinstance(single, gym.spaces.Box):
            raise TypeError(f"Chunks are made of actions in a Box, got {single}.")
        self.action_space = gym.spaces.Box(
            np.tile(single.low, (length, 1)),
            np.tile(single.high, (length, 1)),
            dtype=np.float32,
        )
        self._shape = (length, *single.shape)
        self._check_one = env.get_wrapper_attr("check_action")
        # Images that are taken once a step play in real time at this rate.
        self.metadata = {
            **env.metadata,
            "render_fps": env.metadata["render_fps"] / length,
        }

    def check_action(self, action: Any) -> Array:
        """The chunk as float64 numbers (n, actions); an error if one of its actions is rejected."""
        return np.array(
            [self._check_one(row) for row in spaces.numbers(action, self._shape)]
        )

    def step(self, action: Any) -> Transition:
        """Execute the chunk, until its end or the episode's."""
        done = list(execute(self.env, self.check_action(action)))
        rewards = np.zeros(self._length)
        rewards[: len(done)] = [step.reward for step in done]
        last = done[-1]
        clipped = np.any([step.info["clipped"] for step in done], axis=0)
        info = {
            **last.info,
            "clipped": clipped,
            "rewards": rewards,
            "executed": len(done),
        }
        return (
            last.observation,
            float(rewards.sum()),
            last.terminated,
            last.truncated,
            info,
        )
