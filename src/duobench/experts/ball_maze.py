"""Ball-Maze: both arms lift the board and tilt it about its middle, run by run."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from duobench.experts.motion import (
    CONTROL_STEP,
    Arms,
    Script,
    carry,
    come_down,
    down,
    grip,
    nearest_turn,
)
from duobench.objects.maze_board import GRIP_OFFSET, cell_at, cell_centre
from duobench.objects.mazes import MAZES, Cell, Direction, Maze
from duobench.spatial import SE3, rotation_by
from duobench.types import SIDES, Side

_APPROACH = 0.08
"""Height in metres above the grips from which the tools come straight down."""
_OPENING = 0.32
"""Opening on the way down: wide enough for the bar, narrow enough for the gap to the rim."""
_GRASP_HEIGHT = 0.030
"""Height in metres of the tool centre points above the table: the fingertips keep clear of it."""
_LIFT = 0.07
"""Height in metres by which the board is lifted: its edge stays above the table at any tilt."""

_TILT = math.radians(10)
"""Tilt of the board during a run, in radians."""
_TILT_RATE = math.radians(60) * CONTROL_STEP
"""Largest change of the tilt in one control step, in radians."""
_CENTRING, _DAMPING = 4.0, 1.0
"""Tilt across a run for an offset from the middle of the corridor (rad/m) and for a speed across
it (rad per m/s), so that the ball passes side openings."""
_MAX_RUN_STEPS = 60
_AT_REST = 0.02
"""Speed of the ball on the board in m/s below which a run has ended."""


def script(arms: Arms) -> Script:
    """Lift the board and let the ball roll to the goal."""
    while not all(arms.grasps(side, "board") for side in SIDES):
        yield from grasp(arms, *SIDES)
    yield from lift(arms, *SIDES)
    yield from solve(arms, *SIDES)


def grip_poses(arms: Arms, *sides: Side) -> dict[Side, SE3]:
    """Tool poses around grips: around two opposite ones that lie nearest to the arms' sides."""
    board = arms.sim.pose("board")
    yaw = nearest_turn(board.yaw, math.pi / 2)
    x, y, _ = board.translation
    return {
        side: down(
            x - side.sign * GRIP_OFFSET * math.sin(yaw),
            y + side.sign * GRIP_OFFSET * math.cos(yaw),
            _GRASP_HEIGHT,
            yaw=yaw,
        )
        for side in sides
    }


def grasp(arms: Arms, *sides: Side) -> Script:
    """Close grippers around grips of the board."""
    poses = grip_poses(arms, *sides)
    yield from come_down(arms, poses, opening=_OPENING, above=_APPROACH)
    # One after the other: the first grip brings the board into line with its gripper.
    for side in arms.variety.ordered(sides):
        yield from grip(arms, side)


def lift(arms: Arms, *sides: Side) -> Script:
    """Lift the board, level."""
    high = arms.sim.pose("board").moved(z=_LIFT)
    yield from carry(arms, "board", high, *sides, speed=0.2)


def solve(arms: Arms, *sides: Side) -> Script:
    """Tilt the board, run by run, until the ball is in the goal's cell."""
    tilt = _Tilt(arms, sides)
    maze = MAZES[int(arms.sim.variants["board"])]
    while plan := maze.plan(cell := cell_at(*_ball(arms))):
        yield from _run(tilt, maze, cell, plan[0])


class _Tilt:
    """The grasped board as a platform that arms tilt about its middle."""

    def __init__(self, arms: Arms, sides: Iterable[Side]) -> None:
        self.arms = arms
        board = arms.sim.pose("board")
        self._grasps = {side: board.inverse() @ arms.targets[side] for side in sides}
        self._level = SE3.at(*board.translation, yaw=board.yaw)
        self.slope = np.zeros(2)
        """Downward slope along the board's x and y, in radians."""

    def towards(self, slope: np.ndarray) -> None:
        """Set the tools one control step nearer to a slope."""
        self.slope = self.slope + np.clip(slope - self.slope, -_TILT_RATE, _TILT_RATE)
        board = self._level @ SE3(rotation_by([-self.slope[1], self.slope[0], 0.0]))
        for side, grasp in self._grasps.items():
            self.arms.targets[side] = board @ grasp


def _run(tilt: _Tilt, maze: Maze, cell: Cell, direction: Direction) -> Script:
    """Tilt until the ball has come to rest at the end of a run."""
    end = np.array(cell_centre(maze.run(cell, direction)))
    along = np.array(direction.value, dtype=float)
    across = 1.0 - np.abs(along)
    last = _ball(tilt.arms)
    for _ in range(_MAX_RUN_STEPS):
        yield
        ball = _ball(tilt.arms)
        velocity, last = (ball - last) / CONTROL_STEP, ball
        tilt.towards(_TILT * along + across * (_CENTRING * (end - ball) - _DAMPING * velocity))
        if along @ (ball - end) > 0.0 and np.abs(velocity).max() < _AT_REST:
            return


def _ball(arms: Arms) -> np.ndarray:
    """Where the ball is on the board (2,), in the board's frame and metres."""
    return arms.sim.pose("board").inverse().apply(arms.sim.position("ball"))[:2]
