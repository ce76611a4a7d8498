"""The joints of one arm and of both: ranges, speeds, and home."""

from __future__ import annotations

import numpy as np

from duobench.robot.fr3_links import LINKS

JOINT_RANGES = np.array([link.joint.limits for link in LINKS if link.joint is not None])
"""Joint ranges (7, 2) in radians."""
JOINT_RANGES.setflags(write=False)

VELOCITY_LIMITS = (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)
"""Joint velocity limits in rad/s [Franka data sheet]."""

_LEFT_HOME = (0.48797692, -0.57224476, -0.58536988, -2.57958827, 0.86400183, 2.0530809, -0.85965005)
HOME_JOINTS = np.array([_LEFT_HOME, np.multiply(_LEFT_HOME, (-1, 1, -1, 1, -1, 1, -1))])
"""Home configuration (2, 7) in radians; the right arm mirrors the left."""
HOME_JOINTS.setflags(write=False)
