"""The frames of the arms, and forward kinematics in NumPy alone, as real arms need it.

The table frame is the world frame: origin under the duo mount on the table top, x away from the
robot, y to its left, z up. The simulated robot is built from the same numbers, so both agree.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.spatial import SE3
from duobench.core.types import (
    ARM_JOINTS,
    SIDES,
    Array,
    Side,
)
from duobench.world.robot.fr3_links import LINKS
from duobench.world.robot.gripper import GRIPPER

FLANGE_OFFSET = 0.107
"""Flange beyond link 7 along its z, in metres [Menagerie franka_fr3]."""
LINK7_FROM_FLANGE = SE3.at(z=FLANGE_OFFSET)
"""Pose of the flange in link 7."""
LINK7_FROM_TCP = SE3.at(z=FLANGE_OFFSET + GRIPPER.tool_offset)
"""Pose of the tool centre point in link 7; both have the same orientation."""

BASE_POSES = {
    Side.LEFT: SE3.from_wxyz(
        (0.865641, -0.436978, 0.0225312, -0.243326), (0.0, 0.05018, 0.342)
    ),
    Side.RIGHT: SE3.from_wxyz(
        (0.865641, 0.436978, 0.0225312, 0.243326), (0.0, -0.05018, 0.342)
    ),
}
"""World from arm base [manufacturer's duo workcell, as used by Robot Control Stack]."""
SHOULDERS = {side: base.apply(LINKS[1].position) for side, base in BASE_POSES.items()}
"""Middle of each arm's shoulder (3,) in the table frame: where the axes of joints 1 to 3 meet."""


_Z = (0.0, 0.0, 1.0)
_FRAMES = tuple(
    SE3.from_wxyz(link.wxyz, link.position) for link in LINKS if link.joint is not None
)
"""Pose of each link that turns in the one before it, at joint position 0; link 0 is the base."""


def tool_pose(side: Side, joints: ArrayLike) -> SE3:
    """Tool pose of one arm in the table frame at joint positions (7,) in radians."""
    pose = BASE_POSES[side]
    for frame, angle in zip(_FRAMES, np.asarray(joints).tolist(), strict=True):
        pose = pose @ frame @ SE3.about(_Z, angle)
    return pose @ LINK7_FROM_TCP


def tcp_poses(joints: ArrayLike) -> Array:
    """Tool centre points in the table frame (2, 7) of both arms, as a `DuoState` has them.

    Each is x y z qx qy qz qw with qx >= 0; joint positions (2, 7) are in radians, left then right.
    """
    rows = np.asarray(joints, dtype=np.float64).reshape(len(SIDES), ARM_JOINTS)
    poses = np.array(
        [tool_pose(side, row).tquat for side, row in zip(SIDES, rows, strict=True)]
    )
    poses[poses[:, 3] < 0.0, 3:] *= -1.0
    return poses


def tool_jacobians(joints: Array) -> Array:
    """Motion of the tools with each joint (..., 3, 7), in m/rad in the frames of the arms' bases.

    At joint positions (..., 7) in radians; the same for both sides.
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
    tool = position + rotation @ LINK7_FROM_TCP.translation
    return np.swapaxes(np.cross(axes, tool[..., None, :] - origins), -1, -2)


def tool_frames(side: Side, joints: Array) -> tuple[Array, Array]:
    """Tool poses of one arm in the table frame at joint positions (n, 7) in radians.

    Returns positions (n, 3) in metres and rotation matrices (n, 3, 3).
    """
    base = BASE_POSES[side]
    rotation = np.broadcast_to(base.rotation, (len(joints), 3, 3))
    position = np.broadcast_to(base.translation, (len(joints), 3))
    for frame, angles in zip(_FRAMES, joints.T, strict=True):
        position = position + _product(rotation, frame.translation[:, None])[..., 0]
        rotation = _product(_product(rotation, frame.rotation), _turns(angles))
    offset = LINK7_FROM_TCP.translation[:, None]
    return position + _product(rotation, offset)[..., 0], _product(
        rotation, LINK7_FROM_TCP.rotation
    )


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
