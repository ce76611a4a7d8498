"""Depth as LeRobot 0.6 keeps it: codes of 12 bits, finer the nearer, in a video without loss.

Its readers turn codes into metres by what `INFO` says. Its own defaults have no code for no depth;
here 0 stays 0.
"""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.types import Array
from duobench.world.robot.cameras import FARTHEST

CODES = 4096
_SHIFT = 1.0
"""Distance in metres before the camera from which steps grow in proportion: they are 0.5 mm there,
0.8 mm at 0.5 m and 1.5 mm at 2 m, and half of that is the largest error."""
UNIT = "m"
INFO: dict[str, Any] = {
    "is_depth_map": True,
    "depth_unit": UNIT,
    "video.depth_min": 0.0,
    "video.depth_max": FARTHEST,
    "video.shift": _SHIFT,
    "video.use_log": True,
}
"""Keys of a feature's `info` by which LeRobot reads its frames."""


@cache
def metres() -> Array:
    """The depth (4096,) in metres that each code stands for."""
    rate = math.log((FARTHEST + _SHIFT) / _SHIFT) / (CODES - 1)
    return np.array([_SHIFT * math.expm1(rate * code) for code in range(CODES)])


@cache
def _bounds() -> NDArray[np.float32]:
    return ((metres()[1:] + metres()[:-1]) / 2).astype(np.float32)


def encoded(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """The codes (height, width) of depths in metres, none of which is beyond `FARTHEST`."""
    return np.searchsorted(_bounds(), depth).astype(np.uint16)
