"""Ball-Maze: both arms lift the board and tilt it about its middle, run by run."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import SE3, dot, rotation_by
from duobench.core.types import SIDES, Array, Side
from duobench.tasks.experts.handling import carry, come_down
from duobench.tasks.experts.motion import (
    CONTROL_STEP,
    Arms,
    Script,
    down,
    grip,
    nearest_turn,
)
from duobench.world.objects.maze_board import GRIP_OFFSET, cell_at, cell_centre
from duobench.world.objects.mazes import MAZES, Direction

_APPROACH = 0.08
"""Height in metres above the grips from which the tools come straight down."""
OPENING = 0.32
"""Opening on the way down: wide enough for the bar, narrow enough for the gap to the rim."""
TILT_RATE = math.radians(75) * CONTROL_STEP
"""Largest change of the expert's tilt in one control step, in radians."""
TILT_RAMP = math.radians(12) * CONTROL_STEP
"""Largest change of that change from one control step to the next, in radians: joints that start
and stop at once are hard on a robot, and hard to learn from."""
_CENTRING, _DAMPING = 4.0, 1.0
"""Tilt across a run for an offset from the middle of the corridor (rad/m) and for a speed across
it (rad per m/s), so that the ball passes side openings."""
_MAX_RUN_STEPS = 60
_STAY = 30
"""Control steps for which the ball is kept in the goal."""
_AT_WALL = 0.004
"""How far beyond the middle of its last cell, in metres, the ball is about to meet the wall there,
which is 8 mm beyond: the next tilt may begin."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Handling:
    """How the board is taken and moved; what is not given is as the expert does it."""

    other_grips: bool = False
    """Whether the arms take the pair of grips that lies less near to their sides."""
    grasp_height: float = 0.030
    """Height in metres of the tool centre points above the table: the fingertips keep clear of
    it."""
    lift: float = 0.07
    """Height in metres by which the board is lifted: its edge stays above the table when tilted."""
    tilt: float = math.radians(12)
    """Tilt of the board during a run, in radians."""


PLAIN = Handling()


def script(arms: Arms, way: Handling = PLAIN) -> Script:
    """Lift the board and let the ball roll to the goal."""
    yield from take_up(arms, way)
    yield from solve(arms, *SIDES, way=way)


def take_up(arms: Arms, way: Handling = PLAIN) -> Script:
    """Grasp the board with both arms and lift it."""
    while not all(arms.grasps(side, "board") for side in SIDES):
        yield from grasp(arms, *SIDES, way=way)
    yield from lift(arms, *SIDES, way=way)


def grip_poses(
    arms: Arms,
    *sides: Side,
    way: Handling = PLAIN,
) -> dict[Side, SE3]:
    """Tool poses around two opposite grips."""
    board = arms.sim.pose("board")
    yaw = nearest_turn(board.yaw, math.pi / 2)
    if way.other_grips:
        yaw -= math.copysign(math.pi / 2, yaw)
    x, y, _ = board.translation
    return {
        side: down(
            x - side.sign * GRIP_OFFSET * math.sin(yaw),
            y + side.sign * GRIP_OFFSET * math.cos(yaw),
            way.grasp_height,
            yaw=yaw,
        )
        for side in sides
    }


def grasp(
    arms: Arms,
    *sides: Side,
    way: Handling = PLAIN,
) -> Script:
    """Close grippers around grips of the board."""
    poses = grip_poses(arms, *sides, way=way)
    yield from come_down(
        arms,
        poses,
        opening=OPENING,
        above=_APPROACH,
    )
    # One after the other: the first grip brings the board into line with its gripper.
    for side in arms.variety.ordered(sides, float(arms.sim.position("board")[1])):
        yield from grip(arms, side)


def lift(
    arms: Arms,
    *sides: Side,
    way: Handling = PLAIN,
) -> Script:
    """Lift the board, level."""
    high = arms.sim.pose("board").moved(z=way.lift)
    yield from carry(
        arms,
        "board",
        high,
        *sides,
        speed=0.2,
    )


def solve(
    arms: Arms,
    *sides: Side,
    way: Handling = PLAIN,
) -> Script:
    """Tilt the board, run by run, until the ball lies in the goal's cell, and keep it there."""
    board = TiltedBoard(arms, sides, way.tilt)
    stayed = 0
    while stayed < _STAY:
        direction = board.next_run()
        if direction:
            yield from board.run(direction)
            stayed = 0
        else:
            yield from board.lean(board.goal_slope, 1)
            stayed += 1


class TiltedBoard:
    """The grasped board as a platform that arms tilt about its middle."""

    def __init__(
        self,
        arms: Arms,
        sides: Iterable[Side],
        tilt: float,
        *,
        rate: float = TILT_RATE,
        ramp: float = TILT_RAMP,
    ) -> None:
        """Begin where the board is.

        Args:
            arms: The arms.
            sides: Those that hold the board.
            tilt: Tilt during a run, in radians.
            rate: Largest change of the tilt in one control step, in radians.
            ramp: Largest change of that change from one control step to the next, in radians.
        """
        self._max_rate, self._ramp = rate, ramp
        self._arms = arms
        self._maze = MAZES[int(arms.sim.variants["board"])]
        self._tilt = tilt
        board = arms.sim.pose("board")
        self._level = SE3.at(*board.translation, yaw=board.yaw)
        self._slope, self._rate = -board.rotation[2, :2], np.zeros(2)
        table_from_board = self._pose()
        self._grasps = {
            side: table_from_board.inverse() @ arms.targets[side] for side in sides
        }
        self.wanted = np.zeros(2)
        """Downward slope along the board's x and y that it was last led towards, in radians."""
        self.goal_slope = tilt / 2 * np.sign(cell_centre(self._maze.goal))
        """Downward slope into the goal's corner, which keeps the ball there."""

    def next_run(self) -> Direction | None:
        """The next run on a shortest way to the goal; None if the ball is in its cell."""
        return next(iter(self._maze.plan(cell_at(*self._ball())) or ()), None)

    def run(self, direction: Direction) -> Script:
        """Tilt until the ball is at the end of a run."""
        end = np.array(cell_centre(self._maze.run(cell_at(*self._ball()), direction)))
        along = np.array(direction.value, dtype=float)
        across = 1.0 - np.abs(along)
        last = self._ball()
        for _ in range(_MAX_RUN_STEPS):
            yield
            ball = self._ball()
            velocity, last = (ball - last) / CONTROL_STEP, ball
            centring = _CENTRING * (end - ball) - _DAMPING * velocity
            self.towards(self._tilt * along + across * centring)
            if dot(along, ball - end) > _AT_WALL:
                return

    def lean(self, slope: Array, steps: int) -> Script:
        """Lead the board to a slope (2,), in radians, for some control steps."""
        for _ in range(steps):
            self.towards(slope)
            yield

    def _ball(self) -> Array:
        """Position of the ball on the board (2,), in the board's frame and metres."""
        sim = self._arms.sim
        return sim.pose("board").inverse().apply(sim.position("ball"))[:2]

    def _pose(self) -> SE3:
        """The pose that the board is led to in this control step, in the table frame."""
        return self._level @ SE3(rotation_by([-self._slope[1], self._slope[0], 0.0]))

    def towards(self, slope: Array) -> None:
        """Set the tools one control step nearer to a slope (2,), in radians."""
        self.wanted = slope
        ahead = slope - self._slope
        # The fastest that still comes to rest at the slope, if every step takes one ramp off it.
        ramp = self._ramp
        speed = (np.sqrt(ramp**2 + 8.0 * ramp * np.abs(ahead)) - ramp) / 2.0
        rate = np.copysign(np.minimum(speed, self._max_rate), ahead)
        self._rate = self._rate + np.clip(rate - self._rate, -ramp, ramp)
        self._slope = self._slope + self._rate
        table_from_board = self._pose()
        for side, grasp in self._grasps.items():
            self._arms.targets[side] = table_from_board @ grasp
