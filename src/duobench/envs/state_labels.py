"""Proprioception as a data set for learning holds it: names of the numbers of its state.

They all stand in one column, since that is the only one that policies of LeRobot, openpi and
Isaac-GR00T read proprioception from: further ones are carried along, and never seen.
"""

from collections.abc import Collection, Mapping, Sequence
from enum import StrEnum
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.envs.spaces import JOINT_NAMES, POSE_NAMES

_GRIPPER = "_gripper"


class StatePart(StrEnum):
    """Part that a state may hold behind joint positions and openings."""

    TCP_POSE = "tcp_pose"
    """Tool poses x y z qx qy qz qw in the table frame, as every environment shows them."""
    JOINT_VELOCITY = "joint_velocity"
    """Joint velocities in rad/s, which are recorded, and shown by no environment."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its 14 numbers, left then right."""
        if self is StatePart.TCP_POSE:
            return tuple(name for name in POSE_NAMES if not name.endswith(_GRIPPER))
        return tuple(
            f"{name}_velocity" for name in JOINT_NAMES if not name.endswith(_GRIPPER)
        )


SHOWN = (StatePart.TCP_POSE,)
"""Parts that an environment's observation has under the same name."""


def names_of(parts: Collection[StatePart]) -> tuple[str, ...]:
    """Names of the numbers of a state with some parts, in order."""
    return (
        *JOINT_NAMES,
        *(name for part in StatePart if part in parts for name in part.names),
    )


def find(names: Sequence[str]) -> tuple[StatePart, ...] | None:
    """Return the parts of a state whose numbers have exactly these names, or None."""
    choices = (
        each
        for count in range(len(StatePart) + 1)
        for each in combinations(StatePart, count)
    )
    return next((parts for parts in choices if names_of(parts) == tuple(names)), None)


def shown(
    observation: Mapping[str, Any], parts: Collection[StatePart]
) -> NDArray[np.float32]:
    """The state (n,) with some parts, all of them in `SHOWN`, from an observation."""
    keys = ("agent_pos", *(part.value for part in StatePart if part in parts))
    return np.concatenate([np.asarray(observation[key], np.float32) for key in keys])
