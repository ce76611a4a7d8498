"""The limits of both arms as an environment has them, and slower ones."""

from __future__ import annotations

import math

import numpy as np

from duobench.backend import DuoLimits
from duobench.errors import OptionError
from duobench.robot.joints import JOINT_RANGES, VELOCITY_LIMITS
from duobench.types import ARM_JOINTS, CONTROL_HZ, FLAT_SIZE, SIDES

RANGE_MARGIN = 0.05
"""Distance in radians that real arms keep from the ends of their joints' ranges."""


def duo_limits(speed_fractions: tuple[float, float] = (1.0, 1.0), margin: float = 0.0) -> DuoLimits:
    """Limits of both arms.

    Args:
        speed_fractions: Part of the joints' speed limits that the left and the right arm may use.
        margin: Distance in radians from the ends of the joints' ranges.

    Raises:
        OptionError: A fraction is not over 0 and at most 1.
    """
    low, high = np.zeros(FLAT_SIZE), np.ones(FLAT_SIZE)
    max_change = np.full(FLAT_SIZE, np.inf)
    for side, fraction in zip(SIDES, speed_fractions, strict=True):
        check_speed_fraction(fraction)
        start = side.index * (ARM_JOINTS + 1)
        joints = slice(start, start + ARM_JOINTS)
        low[joints], high[joints] = JOINT_RANGES.T + np.array([[margin], [-margin]])
        max_change[joints] = np.multiply(VELOCITY_LIMITS, fraction) / CONTROL_HZ
    return DuoLimits(low=low, high=high, max_change=max_change)


def check_speed_fraction(fraction: float) -> None:
    """Reject what is no part of the joints' speed limits.

    Raises:
        OptionError: It is not over 0 and at most 1.
    """
    if not (math.isfinite(fraction) and 0.0 < fraction <= 1.0):
        raise OptionError(f"speed_fraction is over 0 and at most 1, got {fraction!r}.")
