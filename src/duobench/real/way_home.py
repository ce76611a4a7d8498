"""Way home: first a little back along the tools, so that fingers leave what they enclosed."""

from collections.abc import Iterator, Sequence

import numpy as np

from duobench.core.types import SIDES, Array, Side
from duobench.real.follower import HIGHEST, LOWEST, PERIOD
from duobench.real.guard import Guard
from duobench.world.robot.frames import Robot
from duobench.world.robot.joints import speed_limits

RETREAT = 0.05
"""Distance in metres that hands go back before the way home: fingers are shorter."""
STEP = 0.01
"""Part of that way in metres which is taken to be straight in joint space."""
HOME_SHARE = 0.8
"""Part of the speed on the way home that the path itself takes; the rest is for catching up."""
SLOWEST = 0.02
"""Speed in rad/s with which a joint leaves an end of its range."""
_EPSILON, _DAMPING = 1e-6, 1e-3


def path_home(
    guard: Guard | None,
    here: Array,
    robot: Robot,
    *,
    retreats: bool,
) -> list[Array]:
    """A path from joint positions (2, 7) in radians; see `Guard.plan_path`.

    Hands that may have been around something go back first, where the guard finds that free.

    Raises:
        BackendError: The guard found no free one.
    """
    back: list[Array] = []
    if retreats:
        away = retreated(here, robot)
        if guard is None or guard.is_free(here, [away]):
            here, back = away, [away]
    home = robot.home
    return [*back, *([home] if guard is None else guard.plan_path(here, home))]


def points(
    start: Array,
    end: Array,
    fractions: Array,
    tool_speeds: Sequence[float],
    robot: Robot,
) -> Iterator[Array]:
    """Points (2, 7) on a straight line in joint space, one a control period, `end` the last.

    As fast as the slowest joint and tool may be where they are, so that none leaves the line:
    `fractions` (2, 1) are the parts of the joints' speed limits that each arm takes, and no tool is
    faster than its speed in m/s.
    """
    way, share = end - start, 0.0
    while share < 1.0:
        low, high = map(
            np.array, zip(*map(speed_limits, start + share * way), strict=True)
        )
        speeds = np.maximum(HOME_SHARE * fractions * np.minimum(-low, high), SLOWEST)
        tools = robot.tool_jacobians(start + share * way) @ way[..., None]
        most = HOME_SHARE * np.array(tool_speeds)
        seconds = max(
            np.max(np.abs(way) / speeds), np.max(np.linalg.norm(tools, axis=1).T / most)
        )
        share = min(1.0, share + PERIOD / max(seconds, PERIOD))
        yield start + share * way


def retreated(joints: Array, robot: Robot) -> Array:
    """Joint positions (2, 7) in radians with both tools further back along their own axes.

    Orientations stay. It goes `RETREAT` far, as far as the joints' ranges let it.
    """
    rows = []
    for side in SIDES:
        row = joints[side.index]
        for _ in range(round(RETREAT / STEP)):
            row = np.clip(row + _change(side, row, robot), LOWEST, HIGHEST)
        rows.append(row)
    return np.array(rows)


def _change(side: Side, row: Array, robot: Robot) -> Array:
    """Change of the joints (7,) that takes a tool one step back, by damped least squares."""
    positions, rotations = robot.tool_frames(
        side, np.vstack([row, row + _EPSILON * np.eye(7)])
    )
    moves = (positions[1:] - positions[0]) / _EPSILON
    turns = (rotations[1:] @ rotations[0].T - np.eye(3)) / _EPSILON
    jacobian = np.hstack(
        [moves, turns[:, 2, 1, None], turns[:, 0, 2, None], turns[:, 1, 0, None]]
    )
    wanted = np.concatenate([-STEP * rotations[0][:, 2], np.zeros(3)])
    square = jacobian.T @ jacobian + _DAMPING**2 * np.eye(6)
    return np.array(jacobian @ np.linalg.solve(square, wanted), dtype=np.float64)
