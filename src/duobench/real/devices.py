"""Protocols of one arm, one gripper and one camera.

A driver never blocks its caller: it talks to its device in a thread of its own and gives the
latest reading with the time at which it was taken. What goes wrong is part of a reading; only
`connect` and what a person asks for (`recover`, `activate`) raise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import Image
from duobench.core.types import Array
from duobench.results.labels import Fault

Depth = NDArray[np.float32]
"""Distances along the optical axis (height, width) in metres, 0 where it is not known."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class ArmReading:
    """One arm at one moment."""

    time_s: float
    """Time of the measurement, on the rig's clock."""
    joints: Array
    """Joint positions (7,) in radians."""
    velocities: Array
    """Joint velocities (7,) in rad/s."""
    torques: Array
    """Joint torques (7,) in N·m."""
    is_tracking: bool
    fault: Fault | None = None
    state: Mapping[str, Array] = field(default_factory=dict[str, "Array"])
    """The driver's full robot state by the names of its library, for recordings."""


class Device(Protocol):
    """An arm, a gripper or a camera."""

    def connect(self) -> None:
        """Reach the device; nothing moves.

        Raises:
            BackendError: It cannot be reached, or gives other images than asked for.
        """

    def close(self) -> None:
        """Let go of the device; an arm stops, a gripper keeps its grip. Twice is harmless."""


class Arm(Device, Protocol):
    """One arm, tracked by joint impedance."""

    def read(self) -> ArmReading:
        """The latest reading, after `connect`."""
        ...

    def start(self) -> None:
        """Hold the measured joints and follow `command` from now on.

        Raises:
            BackendError: It cannot, for example because it reports a fault.
        """

    def command(self, joints: Array, velocities: Array) -> None:
        """Track a point of a smooth path; called by a follower at `FOLLOWER_HZ`.

        Args:
            joints: Joint positions (7,) in radians.
            velocities: Joint velocities (7,) in rad/s.
        """

    def stop(self) -> None:
        """Come to rest, damped, and follow no more commands until `start`."""

    def recover(self) -> None:
        """Clear a fault on a person's word; nothing moves.

        Raises:
            BackendError: The fault stays.
        """


@dataclass(frozen=True, kw_only=True, slots=True)
class GripperReading:
    """One gripper at one moment."""

    time_s: float
    """Time of the measurement, on the rig's clock."""
    opening: float
    """Opening, 0 closed to 1 open."""
    is_active: bool
    """Whether it was activated, and moves when it is told to."""
    has_object: bool = False
    fault: Fault | None = None
    """Fault of the gripper, if any; silence is one too."""


class Gripper(Device, Protocol):
    """One gripper."""

    def activate(self) -> None:
        """Move the fingers through their whole range, on a person's word only; `hold` stops it.

        Raises:
            BackendError: It does not become active, or was held.
        """

    def recover(self) -> None:
        """Forget on a person's word that it lost its power; it moves nowhere before `activate`."""

    def read(self) -> GripperReading:
        """The latest reading, after `connect`."""
        ...

    def command(self, opening: float) -> None:
        """Go to an opening, 0 closed to 1 open; returns at once."""

    def hold(self) -> None:
        """Keep the grip as it is: no more movement until the next command."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Frame:
    """One image of a camera, as it came from it."""

    index: int
    """Number of the frame since the camera was connected; a gap is a lost frame."""
    time_s: float
    """Time at which it was taken, on the rig's clock."""
    image: Image
    """Red, green, blue (720, 1280, 3), not rectified."""
    depth: Depth | None = None
    """Depth (720, 1280) of what each pixel of the image shows; None from a camera without."""


class Camera(Device, Protocol):
    """One camera, which takes images all the time once it is connected."""

    def recover(self) -> None:
        """Connect it again on a person's word where something is wrong, such as a pulled plug.

        Raises:
            BackendError: It cannot be connected; that is tried again the next time.
        """

    def latest(self) -> Frame | None:
        """The latest frame; None before the first one."""

    def listen(self, call: Callable[[Frame], None] | None) -> None:
        """Give every frame from now on to a call, in the camera's thread; None ends it."""

    @property
    def fault(self) -> Fault | None:
        """Fault of the camera, if any."""


def image_ages(cameras: Mapping[str, Camera], now: float) -> dict[str, float]:
    """Seconds since the latest image of each camera was taken; infinite without one."""
    latest = {name: camera.latest() for name, camera in cameras.items()}
    return {
        name: now - frame.time_s if frame else math.inf
        for name, frame in latest.items()
    }
