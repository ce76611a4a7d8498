"""Actions of a recording as joint targets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from duobench.data.lerobot.options import ActionSource
from duobench.data.recording import Recording
from duobench.data.schema import action_mode
from duobench.envs.action_modes import JOINT
from duobench.kinematics.inverse import Kinematics
from duobench.spatial import SE3
from duobench.types import ARM_JOINTS, FLAT_SIZE, SIDE_SIZE, SIDES, Array, DuoCommand


@dataclass(frozen=True, kw_only=True, slots=True)
class Residual:
    """How far the tools at the solved joint targets are from the tool poses that were given."""

    targets: int = 0
    """How many poses were solved for, two a row."""
    sum_position: float = 0.0
    """Sum of the distances in metres."""
    sum_rotation: float = 0.0
    """Sum of the angles in radians."""
    max_position: float = 0.0
    """Largest distance in metres."""
    max_rotation: float = 0.0
    """Largest angle in radians."""

    def __add__(self, other: Residual) -> Residual:
        """The residual of both together."""
        return Residual(
            targets=self.targets + other.targets,
            sum_position=self.sum_position + other.sum_position,
            sum_rotation=self.sum_rotation + other.sum_rotation,
            max_position=max(self.max_position, other.max_position),
            max_rotation=max(self.max_rotation, other.max_rotation),
        )

    def __str__(self) -> str:
        """As a sentence part: means and largest values in millimetres and radians."""
        count = max(1, self.targets)
        return (
            f"mean {1000 * self.sum_position / count:.3f} mm and "
            f"{self.sum_rotation / count:.5f} rad, at most {1000 * self.max_position:.3f} mm and "
            f"{self.max_rotation:.5f} rad"
        )


_kinematics = cache(Kinematics)
"""The solver, made when it is first needed."""


def joint_targets(recording: Recording, source: ActionSource) -> tuple[Array, Residual | None]:
    """The actions of a recording as joint targets and openings.

    Args:
        recording: The episode; given actions are joint targets or tool poses, not changes of them.
        source: Which of its numbers to use.

    Returns:
        Actions (T, 16), and the residual if inverse kinematics solved for them.

    Raises:
        DataError: The numbers of its actions are not known.
    """
    mode = action_mode(recording.info)
    if source is ActionSource.SENT or (source is ActionSource.INTENDED and mode != JOINT):
        return recording.sent, None
    if mode == JOINT:
        return recording.action, None
    return _solved(recording)


def _solved(recording: Recording) -> tuple[Array, Residual]:
    """Joint targets of tool poses, solved for from the observed joints of each row."""
    kinematics = _kinematics()
    solved, errors = np.empty((len(recording), FLAT_SIZE)), []
    for row, action in enumerate(recording.action.reshape(-1, len(SIDES), SIDE_SIZE)):
        targets = {side: SE3.from_tquat(action[side.index, :ARM_JOINTS]) for side in SIDES}
        observed = DuoCommand.from_flat(recording.agent_pos[row]).joints
        joints, _ = kinematics.solve(observed, targets)
        solved[row] = DuoCommand(joints=joints, openings=action[:, ARM_JOINTS]).flat
        reached = kinematics.forward(joints)
        errors += [reached[side].distance(targets[side]) for side in SIDES]
    positions, rotations = zip(*errors, strict=True)
    return solved, Residual(
        targets=len(errors),
        sum_position=sum(positions),
        sum_rotation=sum(rotations),
        max_position=max(positions),
        max_rotation=max(rotations),
    )
