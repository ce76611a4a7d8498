"""The joints of one arm and of both: ranges, speeds, and the limits of an environment."""

import math

import numpy as np

from duobench.core.backend import DuoLimits
from duobench.core.errors import OptionError
from duobench.core.types import (
    ARM_JOINTS,
    CONTROL_HZ,
    FLAT_SIZE,
    SIDES,
    Array,
)
from duobench.world.robot.fr3_links import LINKS

JOINT_RANGES = np.array([link.joint.limits for link in LINKS if link.joint is not None])
"""Joint ranges (7, 2) in radians."""
JOINT_RANGES.setflags(write=False)

VELOCITY_LIMITS = (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)
"""Joint velocity limits in rad/s [Franka data sheet]."""

RANGE_MARGIN = 0.05
"""Distance in radians that real arms keep from the ends of their joints' ranges."""


SERVO_LAG = 0.1002
"""Seconds by which a simulated joint that moves evenly is behind its target: damping by stiffness
of the servos, 0.1 in all of them, and friction."""


def duo_limits(
    speed_fractions: tuple[float, float] = (1.0, 1.0),
    margin: float = 0.0,
    lag: float = math.inf,
) -> DuoLimits:
    """Limits of both arms, which use a part of the joints' speed limits, left then right.

    Args:
        speed_fractions: These parts, over 0 and at most 1.
        margin: Distance in radians from the ends of the joints' ranges.
        lag: Seconds by which targets may lead joints that move at these speeds; infinite where
            arms bound their speed by themselves, as real ones do, however far they are behind.
    """
    low, high = np.zeros(FLAT_SIZE), np.ones(FLAT_SIZE)
    max_change = np.full(FLAT_SIZE, np.inf)
    for side, fraction in zip(SIDES, speed_fractions, strict=True):
        check_speed_fraction(fraction)
        start = side.index * (ARM_JOINTS + 1)
        joints = slice(start, start + ARM_JOINTS)
        low[joints], high[joints] = JOINT_RANGES.T + np.array([[margin], [-margin]])
        max_change[joints] = np.multiply(VELOCITY_LIMITS, fraction) / CONTROL_HZ
    lead = max_change * (lag * CONTROL_HZ)
    return DuoLimits(
        low=low,
        high=high,
        max_change=max_change,
        lead=lead,
    )


def check_speed_fraction(fraction: float) -> None:
    """Reject what is no part of the joints' speed limits."""
    if not (math.isfinite(fraction) and 0.0 < fraction <= 1.0):
        raise OptionError(f"speed_fraction is over 0 and at most 1, got {fraction!r}.")


def joint_speed(velocities: Array) -> float:
    """The largest of joint velocities (2, 7) in rad/s, as a part of the joint's speed limit."""
    return float((np.abs(velocities) / VELOCITY_LIMITS).max())


DECELERATIONS = (6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0)
"""Braking of each joint before its end, in rad/s² [manufacturer's robot description]."""
OFFSETS = (0.652, 0.25, 0.2005, 0.3542, 0.5738, 0.4885, 0.4592)
"""Reduction of each joint's speed near its ends, in rad/s [manufacturer's description]."""
_MOST = np.array(VELOCITY_LIMITS)
_TWICE, _OFFSETS = 2.0 * np.array(DECELERATIONS), np.array(OFFSETS)
_LOW, _HIGH = JOINT_RANGES.T


def speed_limits(joints: Array) -> tuple[Array, Array]:
    """Lowest velocities (7,), at most 0, and highest ones, at least 0, of one arm, in rad/s.

    At joint positions (7,) in radians: |dq| <= min(limit, sqrt(2 d (end - q)) - offset).
    """
    down = np.sqrt(_TWICE * np.maximum(joints - _LOW, 0.0)) - _OFFSETS
    up = np.sqrt(_TWICE * np.maximum(_HIGH - joints, 0.0)) - _OFFSETS
    return -np.minimum(np.maximum(down, 0.0), _MOST), np.minimum(
        np.maximum(up, 0.0), _MOST
    )
