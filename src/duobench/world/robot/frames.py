"""A robot: both arms, their mounting and their gripper; its frames, and forward kinematics.

Forward kinematics is in NumPy alone, as real arms need it.

The table frame is the world frame: origin under the duo mount on the table top, x away from the
robot, y to its left, z up. The simulated robot is built from the same numbers, so both agree.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.errors import check_known
from duobench.core.references import load
from duobench.core.spatial import SE3
from duobench.core.types import (
    ARM_JOINTS,
    SIDES,
    Array,
    DuoCommand,
    Side,
)
from duobench.world.robot.fr3_links import LINKS
from duobench.world.robot.gripper import DEFAULT_GRIPPER, GRIPPERS, Gripper
from duobench.world.robot.mounts import DEFAULT_MOUNT, MOUNTS, Mount

FLANGE_OFFSET = 0.107
"""Flange beyond link 7 along its z, in metres [Menagerie franka_fr3]."""

_Z = (0.0, 0.0, 1.0)
_LAST_JOINT = np.eye(ARM_JOINTS)[-1]
_FRAMES = tuple(
    SE3.from_wxyz(link.wxyz, link.position) for link in LINKS if link.joint is not None
)
"""Pose of each link that turns in the one before it, at joint position 0; link 0 is the base."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Robot:
    """Two FR3 arms on a mount, with the same gripper on both."""

    gripper: Gripper = GRIPPERS[DEFAULT_GRIPPER]
    mount: Mount = MOUNTS[DEFAULT_MOUNT]
    link7_from_flange: SE3 = field(init=False, compare=False)
    """Pose of the flange in link 7, turned as the gripper is."""
    link7_from_tcp: SE3 = field(init=False, compare=False)
    """Pose of the tool centre point in link 7; it is turned as the flange."""
    home: Array = field(init=False, compare=False)
    """Home configuration (2, 7) in radians, left then right, with the tools where they are on this
    mount with any gripper, but for its length."""
    shoulders: Mapping[Side, Array] = field(init=False, compare=False)
    """Middle of each arm's shoulder (3,) in the table frame, where joints 1 to 3 meet."""

    def __post_init__(self) -> None:
        yaw, offset = self.gripper.yaw, self.gripper.tool_offset
        flange = SE3.at(z=FLANGE_OFFSET, yaw=yaw)
        tool = SE3.at(z=FLANGE_OFFSET + offset, yaw=yaw)
        home = self.mount.home - yaw * _LAST_JOINT
        home.setflags(write=False)
        bases = self.mount.bases.items()
        shoulders = {side: base.apply(LINKS[1].position) for side, base in bases}
        object.__setattr__(self, "link7_from_flange", flange)
        object.__setattr__(self, "link7_from_tcp", tool)
        object.__setattr__(self, "home", home)
        object.__setattr__(self, "shoulders", shoulders)

    @property
    def home_command(self) -> DuoCommand:
        """Both arms at home, both grippers open."""
        return DuoCommand(joints=self.home, openings=np.ones(len(SIDES)))

    def tool_pose(self, side: Side, joints: ArrayLike) -> SE3:
        """Tool pose of one arm in the table frame at joint positions (7,) in radians."""
        pose = self.mount.bases[side]
        for frame, angle in zip(_FRAMES, np.asarray(joints).tolist(), strict=True):
            pose = pose @ frame @ SE3.about(_Z, angle)
        return pose @ self.link7_from_tcp

    def tcp_poses(self, joints: ArrayLike) -> Array:
        """Tool centre points in the table frame (2, 7) of both arms, as a `DuoState` has them.

        Each is x y z qx qy qz qw with qx >= 0; joint positions (2, 7) are in radians, left then
        right.
        """
        rows = np.asarray(joints, dtype=np.float64).reshape(len(SIDES), ARM_JOINTS)
        poses = np.array(
            [
                self.tool_pose(side, row).tquat
                for side, row in zip(SIDES, rows, strict=True)
            ]
        )
        poses[poses[:, 3] < 0.0, 3:] *= -1.0
        return poses

    def tool_jacobians(self, joints: Array) -> Array:
        """Motion of the tools with each joint (..., 3, 7), in m/rad.

        In the frames of the arms' bases, at joint positions (..., 7) in radians; the same for both
        sides.
        """
        rotation = np.broadcast_to(np.eye(3), (*joints.shape[:-1], 3, 3))
        position = np.zeros(3)
        axes, origins = np.empty((*joints.shape, 3)), np.empty((*joints.shape, 3))
        for number, frame in enumerate(_FRAMES):
            position = position + rotation @ frame.translation
            rotation = rotation @ frame.rotation
            axes[..., number, :], origins[..., number, :] = rotation[..., 2], position
            cosine, sine = (
                np.cos(joints[..., number, None]),
                np.sin(joints[..., number, None]),
            )
            x, y = rotation[..., 0], rotation[..., 1]
            rotation = np.stack(
                [cosine * x + sine * y, cosine * y - sine * x, rotation[..., 2]], -1
            )
        tool = position + rotation @ self.link7_from_tcp.translation
        return np.swapaxes(np.cross(axes, tool[..., None, :] - origins), -1, -2)

    def tool_frames(self, side: Side, joints: Array) -> tuple[Array, Array]:
        """Tool poses of one arm in the table frame at joint positions (n, 7) in radians.

        Returns positions (n, 3) in metres and rotation matrices (n, 3, 3).
        """
        base = self.mount.bases[side]
        rotation = np.broadcast_to(base.rotation, (len(joints), 3, 3))
        position = np.broadcast_to(base.translation, (len(joints), 3))
        for frame, angles in zip(_FRAMES, joints.T, strict=True):
            position = position + _product(rotation, frame.translation[:, None])[..., 0]
            rotation = _product(_product(rotation, frame.rotation), _turns(angles))
        offset = self.link7_from_tcp.translation[:, None]
        return position + _product(rotation, offset)[..., 0], _product(
            rotation, self.link7_from_tcp.rotation
        )


ROBOT = Robot()
"""The robot of the paper."""
USUAL_ROBOT = "the paper's gripper and mount"
"""Its gripper and mount in words, where `other_robot` is empty."""


@cache
def robot_with(gripper: str, mount: str = DEFAULT_MOUNT) -> Robot:
    """A robot with a gripper, by its name in `GRIPPERS` or its path "module:ATTRIBUTE".

    Raises:
        UnknownNameError: There is no such gripper or mount.
        ImportPathError: The path names no module.
    """
    if ":" in gripper:
        found = load(gripper, "gripper", lambda value: isinstance(value, Gripper))
    else:
        check_known("gripper", gripper, GRIPPERS)
        found = GRIPPERS[gripper]
    check_known("mount", mount, MOUNTS)
    return Robot(gripper=found, mount=MOUNTS[mount])


def other_robot(gripper: str, mount: str) -> str:
    """Return what is not the paper's of a gripper and a mount, in a word; empty for neither."""
    usual = {gripper: DEFAULT_GRIPPER, mount: DEFAULT_MOUNT}
    return " ".join(given for given, default in usual.items() if given != default)


def _turns(angles: Array) -> Array:
    """Rotation matrices (n, 3, 3) about z by angles (n,) in radians."""
    # Of the standard library: NumPy's differ between processors in the last bit.
    cosine = np.array([math.cos(angle) for angle in angles.tolist()])
    sine = np.array([math.sin(angle) for angle in angles.tolist()])
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = cosine
    turns[:, 1, 0], turns[:, 0, 1] = sine, -sine
    turns[:, 2, 2] = 1.0
    return turns


def _product(a: Array, b: Array) -> Array:
    """Matrix products of a (..., 3, 3) with b (..., 3, m), added up in a fixed order."""
    first, second, third = (a[..., :, k, None] * b[..., None, k, :] for k in range(3))
    return first + second + third
