"""Spaces of actions and observations, and the check that an action is one.

All arrays that cross the public surface are float32, as in data sets and policies of the field.
"""

import math
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from duobench.core.backend import DuoLimits
from duobench.core.errors import ActionError
from duobench.core.types import (
    ARM_JOINTS,
    SIDES,
    Array,
    real_array,
)

JOINT_MARGIN = 0.5
"""Distance in radians of a measured joint beyond its range; the engine's limits are soft."""
WORKSPACE = 1.5
"""Largest coordinate of a tool position in an action, in metres."""
REACH = 1.9
"""No tool gets further from the table frame's origin along any axis, in metres: the links from the
base to the tool centre point are 1.47 m long together, and the bases are 0.34 m high."""
MAX_SHIFT = 0.1
"""Largest relative translation in one control step, in metres: 3 m/s, the arm's limit."""
MAX_TURN = 0.2
"""Largest relative rotation vector component in one control step, in radians: 6 rad/s."""


def _names(*numbers: str) -> tuple[str, ...]:
    return tuple(f"{side}_{name}" for side in SIDES for name in (*numbers, "gripper"))


JOINT_NAMES = _names(*(f"joint_{number}" for number in range(1, ARM_JOINTS + 1)))
"""Names of the 16 numbers of a joint action."""
POSE_NAMES = _names("x", "y", "z", "qx", "qy", "qz", "qw")
"""Names of the 16 numbers of a Cartesian action."""
SHIFT_NAMES = _names("dx", "dy", "dz", "rx", "ry", "rz")
"""Names of the 14 numbers of a relative Cartesian action."""


def box(low: ArrayLike, high: ArrayLike) -> gym.spaces.Box:
    """A float32 box that lies inside float64 bounds: rounding never leaves the range."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    low32, high32 = low.astype(np.float32), high.astype(np.float32)
    with np.errstate(under="ignore"):  # next to 0 is a number that underflows
        low32 = np.where(low32 < low, np.nextafter(low32, np.float32(np.inf)), low32)
        high32 = np.where(
            high32 > high, np.nextafter(high32, np.float32(-np.inf)), high32
        )
    return gym.spaces.Box(low32, high32, dtype=np.float32)


def joint_actions(limits: DuoLimits) -> gym.spaces.Box:
    """Absolute joint targets in radians and openings 0..1."""
    return box(limits.low, limits.high)


def relative_joint_actions(limits: DuoLimits) -> gym.spaces.Box:
    """Joint displacements within the velocity limits; the openings stay absolute."""
    low, high = -limits.max_change, limits.max_change.copy()
    slots = opening_slots(len(low))
    low[slots], high[slots] = 0.0, 1.0
    return box(low, high)


def pose_actions(_limits: DuoLimits) -> gym.spaces.Box:
    """Absolute tool poses x y z qx qy qz qw in the table frame, and openings."""
    return _tool_actions([*[WORKSPACE] * 3, *[1.0] * 4])


def relative_pose_actions(_limits: DuoLimits) -> gym.spaces.Box:
    """Tool displacements: translation, rotation vector; the openings stay absolute."""
    return _tool_actions([*[MAX_SHIFT] * 3, *[MAX_TURN] * 3])


def _tool_actions(high: Sequence[float]) -> gym.spaces.Box:
    return box(np.tile([*np.negative(high), 0.0], 2), np.tile([*high, 1.0], 2))


def observations(limits: DuoLimits) -> gym.spaces.Dict:
    """Space of the robot's proprioception; see `DuoEnv`."""
    margin = np.tile([*[JOINT_MARGIN] * ARM_JOINTS, 0.0], len(SIDES))
    pose = np.tile([*[REACH] * 3, *[1.0] * 4], len(SIDES))
    bounds = {
        "agent_pos": (limits.low - margin, limits.high + margin),
        "tcp_pose": (-pose, pose),
    }
    return gym.spaces.Dict(
        {
            name: gym.spaces.Box(
                low.astype(np.float32), high.astype(np.float32), dtype=np.float32
            )
            for name, (low, high) in bounds.items()
        }
    )


def opening_slots(size: int) -> list[int]:
    """Indices of the openings in an action of `size` numbers: last on each side, in every mode."""
    side = size // len(SIDES)
    return [side - 1, size - 1]


def numbers(
    action: Any,
    shape: tuple[int, ...],
    labels: Sequence[str] = (),
) -> Array:
    """An action as float64 numbers of a given shape; `labels` name them in the message."""
    try:
        array = real_array(action, np.float64)
    except (TypeError, ValueError) as error:
        raise ActionError(
            f"An action is an array of numbers of shape {shape}, got {action!r}."
        ) from error
    if array.shape != shape:
        meaning = f" ({', '.join(labels)})" if labels else ""
        raise ActionError(
            f"An action has shape {shape} here{meaning}, got shape {array.shape}. Nothing was "
            "moved; the environment waits for another action."
        )
    return array


def checked_action(action: Any, labels: Sequence[str]) -> Array:
    """An action as finite float64 numbers, as many as there are labels."""
    array = numbers(action, (len(labels),), labels)
    # A finite sum proves finite numbers, at a fraction of the cost of an array operation.
    if not math.isfinite(sum(array.tolist())):
        wrong = [
            f"{label} is {value}"
            for label, value in zip(labels, array, strict=True)
            if not math.isfinite(value)
        ]
        if wrong:
            raise ActionError(
                f"An action must be finite, but {', '.join(wrong)}. Nothing was moved; the "
                "environment waits for another action."
            )
    return array
