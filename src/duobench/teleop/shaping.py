"""Filter and limits between the pose that a hand wants and the one that is commanded."""

import math
from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import (
    SE3,
    length,
    product,
    rotation_by,
    rotation_vector,
)
from duobench.core.types import CONTROL_HZ, Array, Side
from duobench.world.kinematics.inverse import within_reach
from duobench.world.robot.frames import Robot

MIN_CUTOFF_HZ = 1.5
"""Cutoff of the filter for a hand at rest: 1 mm of tracking noise becomes a fifth of it."""
BETA, BETA_TURN = 20.0, 5.0
"""Rise of the cutoff in Hz for each m/s and each rad/s of the hand."""
SPEED_CUTOFF_HZ = 1.0
"""Cutoff of the speed that raises the other one."""
REACH = 0.78
"""Largest distance in metres of the last wrist joint from the middle of the arm's shoulder. The
scripted experts need 0.76, and inverse kinematics stretches the arm to 0.795."""
BOX = np.array([[0.10, -0.70, 0.0], [0.95, 0.70, 0.90]])
"""Lowest and highest x, y, z of a tool in the table frame, in metres."""
LEASH = 0.10
"""Largest distance in metres from where a tool is to where it is led, so that what a hand presses
into an obstacle does not add up; in free motion the tool lags by up to 0.08."""


class OneEuro:
    """A low-pass filter of poses whose cutoff rises with speed [Casiez et al. 2012].

    A hand at rest is smoothed, a fast one hardly lags.
    """

    def __init__(self) -> None:
        self._pose: SE3 | None = None
        self._speeds = np.zeros((2, 3))

    def reset(self) -> None:
        """Forget earlier poses: the next one is returned unchanged."""
        self._pose = None

    def __call__(self, pose: SE3) -> SE3:
        """The filtered pose, one control step after the last one."""
        if self._pose is None:
            self._pose, self._speeds = pose, np.zeros((2, 3))
            return pose
        last = self._pose
        shift = pose.translation - last.translation
        turn = rotation_vector(product(pose.rotation, last.rotation.T))
        speeds = np.array([shift, turn]) * CONTROL_HZ
        self._speeds = self._speeds + _gain(SPEED_CUTOFF_HZ) * (speeds - self._speeds)
        share = _gain(MIN_CUTOFF_HZ + BETA * length(self._speeds[0]))
        turn_share = _gain(MIN_CUTOFF_HZ + BETA_TURN * length(self._speeds[1]))
        self._pose = SE3(
            product(rotation_by(turn_share * turn), last.rotation),
            last.translation + share * shift,
        )
        return self._pose


def _gain(cutoff_hz: float) -> float:
    """Share of the difference that a first-order low-pass filter closes in one control step."""
    return 1.0 / (1.0 + CONTROL_HZ / (2.0 * math.pi * cutoff_hz))


@dataclass(frozen=True, kw_only=True, slots=True)
class Shaped:
    """Pose that a tool is led to."""

    pose: SE3
    """Its pose in the table frame."""
    is_limited: bool
    """Whether reach, box or leash kept it from where the hand wants it."""


class Shaper:
    """Shapes where a hand leads one tool."""

    def __init__(self, side: Side, robot: Robot) -> None:
        self._side, self._robot = side, robot
        self._filter = OneEuro()

    def reset(self) -> None:
        """Forget the past: the hand let go."""
        self._filter.reset()

    def __call__(self, wanted: SE3, measured: SE3) -> Shaped:
        """Return the pose that a tool is led to where a hand wants another, in the table frame."""
        smooth = self._filter(wanted)
        near = within(measured.translation, smooth.translation, LEASH)
        inside = SE3(smooth.rotation, np.clip(near, *BOX))
        pose = within_reach(self._robot, self._side, inside, REACH)
        is_limited = length(pose.translation - smooth.translation) > 0.0
        return Shaped(pose=pose, is_limited=is_limited)


def within(
    centre: Array,
    point: Array,
    distance: float,
) -> Array:
    """Move a point towards a centre until it is within a distance."""
    away = point - centre
    size = length(away)
    return point if size <= distance else centre + (distance / size) * away
