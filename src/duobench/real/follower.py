"""A follower: thirty targets a second become a smooth path that an arm can be told to track.

Nothing else between us and the arm bounds what it is told, and a jump to a far target trips a
reflex. A follower leads a reference towards the targets, linearly over the control period as the
simulation does, within limits of position, speed and acceleration.
"""

import math
from collections.abc import Sequence

import numpy as np

from duobench.core.errors import ActionError
from duobench.core.types import (
    ARM_JOINTS,
    CONTROL_HZ,
    Array,
    DuoCommand,
)
from duobench.real.rig import ArmConfig
from duobench.world.robot.frames import Robot
from duobench.world.robot.joints import JOINT_RANGES, RANGE_MARGIN, speed_limits

PERIOD = 1.0 / CONTROL_HZ
"""Seconds over which a target is approached linearly."""
GAIN = 25.0
"""Speed in rad/s for each radian that the reference is behind [measured: 8 mrad behind]."""
MAX_STEP_S = 0.02
"""Longest time that one call moves a reference by: after a freeze it goes on, it does not leap."""
NEAR = 0.02
"""Motion of a joint in radians after which the speed of the tool is computed again."""
BRAKING_SHARE = 0.8
"""Part of the acceleration that the approach of a far target is planned with."""

LOWEST, HIGHEST = JOINT_RANGES.T + np.array([[RANGE_MARGIN], [-RANGE_MARGIN]])
"""Range of a reference (7,), in radians."""


class Follower:
    """Leads the reference of one arm; the same calls give the same path.

    It begins at rest at the measured joints (7,) in radians.
    """

    def __init__(self, joints: Array, limits: ArmConfig, robot: Robot) -> None:
        self._robot = robot
        self.speed_fraction = limits.speed_fraction
        """Part of the joints' speed limits, which depend on where they are, that the reference may
        move with. It may change at any time: one that is faster slows down as the acceleration
        allows."""
        self._acceleration, self._tool_speed = limits.acceleration, limits.tool_speed
        self.reset(joints)

    def reset(self, joints: Array) -> None:
        """Begin again, at rest at the measured joints (7,) in radians."""
        start = _checked(joints)
        self.reference = start
        """Joint positions (7,) that the arm is sent, in radians."""
        self.velocity = np.zeros(ARM_JOINTS)
        """Speed of the reference (7,) in rad/s."""
        self._begin = self._end = start
        self._near, self._jacobian = start, self._robot.tool_jacobians(start)
        self._elapsed = PERIOD
        self._is_held = False

    @property
    def is_at_rest(self) -> bool:
        """Whether the reference does not move."""
        return not self.velocity.any()

    def aim(self, joints: Array) -> None:
        """Approach joint positions (7,) in radians, linearly over one control period from now.

        Those out of range are clipped. It ends a hold.
        """
        target = np.clip(_checked(joints), LOWEST, HIGHEST)
        self._begin = self.reference if self._is_held else self._ramped()
        self._end = target
        self._elapsed = 0.0
        self._is_held = False

    def hold(self) -> None:
        """Come to rest as soon as the acceleration allows, and stay there until `aim`."""
        self._is_held = True

    def advance(self, dt: float) -> tuple[Array, Array]:
        """Move the reference on by the seconds since the last call.

        The arm is to track the joint positions (7,) in radians and velocities (7,) in rad/s.
        """
        dt = min(max(dt, 0.0), MAX_STEP_S)
        if dt == 0.0:
            return self.reference.copy(), self.velocity.copy()
        wanted = np.zeros(ARM_JOINTS) if self._is_held else self._wanted(dt)
        self.velocity = velocity = self._next_velocity(self._within(wanted, dt), dt)
        self.reference = self.reference + velocity * dt
        if self._is_held and not velocity.any():
            self._begin = self._end = self.reference
        return self.reference.copy(), velocity.copy()

    def _next_velocity(self, allowed: Array, dt: float) -> Array:
        """The velocity next to one that positions allow, with which the tool is not too fast."""
        if np.abs(self.reference - self._near).max() > NEAR:
            self._near = self.reference
            self._jacobian = self._robot.tool_jacobians(self.reference)
        most, change = self._tool_speed, self._acceleration * dt
        least, largest = self.velocity - change, self.velocity + change
        allowed = allowed * tool_share(self._jacobian, allowed, most)
        velocity = np.minimum(np.maximum(allowed, least), largest)
        if tool_share(self._jacobian, velocity, most) < 1.0:
            # Joints that change together lead from one speed that the tool may have to another.
            turn = allowed - self.velocity
            velocity = self.velocity + turn * min(
                1.0, change / max(np.abs(turn).max(), change)
            )
            velocity = self._within(velocity, dt)
        # Last, so that nothing else changes it; from any speed that was allowed a joint can
        # stop before its range ends.
        return np.minimum(np.maximum(velocity, least), largest)

    def _wanted(self, dt: float) -> Array:
        """The velocity that the targets ask for; without a new target it ends at rest."""
        before = self._ramped()
        self._elapsed = min(self._elapsed + dt, PERIOD)
        after = self._ramped()
        behind = after - (self.reference + (after - before))
        # Far behind, only as fast as the acceleration can still take back on the way.
        braking = 2.0 * BRAKING_SHARE * self._acceleration
        correction = np.minimum(
            GAIN * np.abs(behind), np.sqrt(braking * np.abs(behind))
        )
        wanted = (after - before) / dt + np.copysign(correction, behind)
        # So near and slow that one more call reaches the target: end there, exactly at rest.
        rests = (after == before) & (np.abs(behind) < self._acceleration * dt * dt)
        rests &= np.abs(self.velocity) <= self._acceleration * dt
        return np.where(rests, 0.0, wanted)

    def _ramped(self) -> Array:
        share = self._elapsed / PERIOD
        return self._begin + share * (self._end - self._begin)

    def _within(self, velocity: Array, dt: float) -> Array:
        """The velocity next to one that the joints' positions allow, so that they can stop."""
        low, high = speed_limits(self.reference)
        # Braking before the ends of the range, the way of this call included.
        reach = 2.0 * self._acceleration
        up = np.maximum(HIGHEST - self.reference, 0.0)
        down = np.maximum(self.reference - LOWEST, 0.0)
        high = np.minimum(self.speed_fraction * high, _stopping(up, reach, dt))
        low = np.maximum(self.speed_fraction * low, -_stopping(down, reach, dt))
        return np.minimum(np.maximum(velocity, low), high)


def tool_share(
    jacobian: Array,
    velocity: Array,
    most: float,
) -> float:
    """The part of joint velocities (7,) in rad/s with which a tool moves at most so fast, in m/s.

    The Jacobian (3, 7) is that of `tool_jacobians`.
    """
    speed = math.hypot(*(jacobian @ velocity).tolist())
    return min(1.0, most / speed) if speed > 0.0 else 1.0


def paced(
    last: DuoCommand,
    sent: DuoCommand,
    speeds: Sequence[float],
    robot: Robot,
) -> DuoCommand:
    """A command on the way from one to the next, to which no tool is faster than its speed in m/s.

    Both arms go the same part of the way, so that hands that hold one thing stay together.
    """
    way = sent.joints - last.joints
    most = [speed * PERIOD for speed in speeds]
    share = min(map(tool_share, robot.tool_jacobians(last.joints), way, most))
    if share == 1.0:
        return sent
    return DuoCommand(joints=last.joints + share * way, openings=sent.openings)


def _stopping(
    distance: Array,
    reach: float,
    dt: float,
) -> Array:
    """The speed from which a joint that moves on for `dt` can stop within a distance."""
    step = 0.5 * reach * dt
    return np.maximum(np.sqrt(step * step + reach * distance) - step, 0.0)


def _checked(joints: Array) -> Array:
    values = np.array(joints, dtype=np.float64)
    if values.shape != (ARM_JOINTS,) or not all(map(math.isfinite, values.tolist())):
        raise ActionError(
            f"An arm takes {ARM_JOINTS} finite joint positions, got {joints!r}."
        )
    return values
