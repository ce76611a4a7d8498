"""A short way back along the tools, out of what the fingers were around."""

import numpy as np

from duobench.hardware.follower import HIGHEST, LOWEST
from duobench.robot.frames import tool_frames
from duobench.types import SIDES, Array, Side

RETREAT = 0.05
"""How far in metres hands go back before the way home: the fingers of a 2F-85 are shorter."""
STEP = 0.01
"""Part of that way in metres which is taken to be straight in joint space."""
_EPSILON, _DAMPING = 1e-6, 1e-3


def retreated(joints: Array, distance: float = RETREAT) -> Array:
    """Joint positions (2, 7) in radians with both tools further back along their own axes.

    Orientations stay. It goes as far as the joints' ranges let it, `distance` in metres.
    """
    rows = []
    for side in SIDES:
        row = joints[side.index]
        for _ in range(round(distance / STEP)):
            row = np.clip(row + _change(side, row), LOWEST, HIGHEST)
        rows.append(row)
    return np.array(rows)


def _change(side: Side, row: Array) -> Array:
    """Change of the joints (7,) that takes a tool one step back, by damped least squares."""
    positions, rotations = tool_frames(side, np.vstack([row, row + _EPSILON * np.eye(7)]))
    moves = (positions[1:] - positions[0]) / _EPSILON
    turns = (rotations[1:] @ rotations[0].T - np.eye(3)) / _EPSILON
    jacobian = np.hstack([moves, turns[:, 2, 1, None], turns[:, 0, 2, None], turns[:, 1, 0, None]])
    wanted = np.concatenate([-STEP * rotations[0][:, 2], np.zeros(3)])
    square = jacobian.T @ jacobian + _DAMPING**2 * np.eye(6)
    return jacobian @ np.linalg.solve(square, wanted)
