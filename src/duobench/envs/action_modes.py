"""Action modes: meanings of the numbers of an action.

A further mode is one entry of `ACTION_MODES` and the wrapper that takes its actions.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import gymnasium as gym

from duobench.core.backend import DuoLimits
from duobench.core.errors import check_known
from duobench.core.types import SIDES
from duobench.envs import spaces


@dataclass(frozen=True, kw_only=True, slots=True)
class ActionMode:
    """One meaning of the numbers of an action."""

    name: str
    """Its name, in configurations, recordings and metadata of policies."""
    names: tuple[str, ...]
    """Name of each number: those of the left side, its opening last, then the same on the right."""
    space: Callable[[DuoLimits], gym.spaces.Box]
    """The action space for arms with some limits."""
    wrappers: tuple[str, ...] = ()
    """Import paths `module:CLASS` of the wrappers that make joint targets of an action, from the
    inside out."""

    @property
    def arm_size(self) -> int:
        """Numbers of one arm, without its opening."""
        return len(self.names) // len(SIDES) - 1


JOINT = ActionMode(name="joint", names=spaces.JOINT_NAMES, space=spaces.joint_actions)
JOINT_RELATIVE = ActionMode(
    name="joint_relative",
    names=tuple(f"{name}_change" for name in spaces.JOINT_NAMES),
    space=spaces.relative_joint_actions,
    wrappers=("duobench.envs.action_wrappers:RelativeJointActions",),
)
CARTESIAN = ActionMode(
    name="cartesian",
    names=spaces.POSE_NAMES,
    space=spaces.pose_actions,
    wrappers=("duobench.envs.action_wrappers:CartesianActions",),
)
CARTESIAN_RELATIVE = ActionMode(
    name="cartesian_relative",
    names=spaces.SHIFT_NAMES,
    space=spaces.relative_pose_actions,
    wrappers=(
        *CARTESIAN.wrappers,
        "duobench.envs.action_wrappers:RelativeCartesianActions",
    ),
)

ACTION_MODES: Mapping[str, ActionMode] = MappingProxyType(
    {mode.name: mode for mode in (JOINT, JOINT_RELATIVE, CARTESIAN, CARTESIAN_RELATIVE)}
)
"""Every action mode by its name."""


def get(name: str) -> ActionMode:
    """An action mode by its name; an error lists near misses."""
    check_known("action mode", name, ACTION_MODES)
    return ACTION_MODES[name]
