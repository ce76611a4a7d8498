"""A lab's cell: the box that tools stay in, and obstacles."""

import math
from dataclasses import dataclass

import numpy as np

from duobench.core.errors import OptionError
from duobench.core.types import Array
from duobench.world.robot.frames import Robot

Point = tuple[float, float, float]
LONGEST = 5.0
"""Longest side of an obstacle, and how far away anything is at most, in metres."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Workspace:
    """Box in the table frame that both tools stay in."""

    low: Point = (0.1, -0.6, -0.02)
    """Its least x, y and z in metres."""
    high: Point = (0.8, 0.6, 0.8)
    """Its largest; experts of all tasks stay 0.1 m within the box [measured]."""

    def check(self, robot: Robot) -> None:
        """Reject a box outside of which a tool is at home.

        Raises:
            OptionError: One is.
        """
        tools = robot.tcp_poses(robot.home)[:, :3]
        if not ((self.low < tools) & (tools < self.high)).all():
            x, y, z = tools[0]
            raise OptionError(
                "workspace: low and high of a workspace have both tools at home between them, "
                f"x {x:.2f}, y {-y:.2f} and {y:.2f}, z {z:.2f}; "
                f"got {list(self.low)} and {list(self.high)}."
            )

    def room(self, point: Array) -> float:
        """Least distance in metres of a point (3,) from the sides; negative outside."""
        return float(min(np.min(point - self.low), np.min(self.high - point)))


@dataclass(frozen=True, kw_only=True, slots=True)
class Obstacle:
    """Fixed obstacle that arms and hands keep away from: an upright box."""

    centre: Point
    """Its middle in the table frame, in metres."""
    size: Point
    """Its lengths along its own x, y and z, in metres."""
    yaw: float = 0.0
    """Yaw in radians."""

    def __post_init__(self) -> None:
        if not all(0.0 < length <= LONGEST for length in self.size):
            raise OptionError(
                f"size is three lengths over 0 and at most {LONGEST:g} m, got {list(self.size)}."
            )
        if not all(abs(value) <= LONGEST for value in self.centre):
            raise OptionError(
                f"centre is at most {LONGEST:g} m away along each axis, got {list(self.centre)}."
            )
        if not abs(self.yaw) <= math.tau:
            raise OptionError(
                f"yaw is an angle in radians, at most a turn; got {self.yaw}."
            )
