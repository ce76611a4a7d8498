"""How fast a joint of the FR3 may move, which depends on where it is.

Near an end of its range it may only be so fast that the arm can still stop before it; faster, the
arm stops by itself with an error.
"""

from __future__ import annotations

import numpy as np

from duobench.robot.joints import JOINT_RANGES, VELOCITY_LIMITS
from duobench.types import Array

DECELERATIONS = (6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0)
"""How hard each joint can brake before its end, in rad/s² [manufacturer's robot description]."""
OFFSETS = (0.652, 0.25, 0.2005, 0.3542, 0.5738, 0.4885, 0.4592)
"""What is taken off each joint's speed near its ends, in rad/s [manufacturer's description]."""
_MOST = np.array(VELOCITY_LIMITS)
_TWICE, _OFFSETS = 2.0 * np.array(DECELERATIONS), np.array(OFFSETS)
_LOW, _HIGH = JOINT_RANGES.T


def speed_limits(joints: Array) -> tuple[Array, Array]:
    """The lowest and highest velocity of each joint of one arm.

    Args:
        joints: Joint positions (7,) in radians.

    Returns:
        Lowest velocities (7,), at most 0, and highest ones (7,), at least 0, in rad/s:
        |dq| <= min(limit, sqrt(2 d (end - q)) - offset).
    """
    down = np.sqrt(_TWICE * np.maximum(joints - _LOW, 0.0)) - _OFFSETS
    up = np.sqrt(_TWICE * np.maximum(_HIGH - joints, 0.0)) - _OFFSETS
    return -np.minimum(np.maximum(down, 0.0), _MOST), np.minimum(np.maximum(up, 0.0), _MOST)
