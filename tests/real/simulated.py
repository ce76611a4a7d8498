"""Drivers of arms, grippers and cameras that are computed, with faults that tests give them.

A rig's file names them as `module:NAME`; they need no engine. Arms have no mass and grippers touch
nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from duobench.core.backend import Image
from duobench.core.errors import BackendError
from duobench.core.types import ARM_JOINTS, SIDES, Array, Side
from duobench.real.clock import Clock
from duobench.real.devices import ArmReading, GripperReading
from duobench.real.drivers.frames import TickedCamera
from duobench.real.rig import (
    MAX_ACCELERATION,
    MAX_SPEED_FRACTION,
    MAX_TOOL_SPEED,
    ArmConfig,
    CameraConfig,
    GripperConfig,
    Rig,
)
from duobench.results.labels import Fault, FaultKind
from duobench.world.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH, POLICY_CAMERAS
from duobench.world.robot.mounts import HOME_JOINTS

ARM_RATE = 60.0
"""Natural frequency of a simulated arm in rad/s, critically damped."""
STEP_S = 0.002
GRIPPER_SPEED = 1.76
"""Openings a second: 150 mm/s over 85 mm [data sheet of the 2F-85]."""
SILENCE_S = 0.2
"""Seconds without an answer after which a gripper's silence is a fault."""
MARK = 16
"""Edge in pixels of one square of the number in a simulated image."""
MARKS = 24
"""Binary digits of that number."""


class SimulatedArm:
    """An arm, at home of the side that its address names, which tracks as a damped spring does."""

    is_computed = True

    def __init__(self, config: ArmConfig, clock: Clock) -> None:
        self._clock = clock
        self._joints = HOME_JOINTS[Side(config.address).index].copy()
        self._velocities = np.zeros(ARM_JOINTS)
        self._target, self._speed = self._joints.copy(), np.zeros(ARM_JOINTS)
        self._time = clock.now()
        self._is_tracking = False
        self._fault: Fault | None = None
        self._last: ArmReading | None = None
        self.is_silent = False
        """Whether it gives no new readings, as an arm whose cable is out."""
        self.is_reachable = True
        self.commands: int = 0
        """How often it was told where to be."""

    def connect(self) -> None:
        """Reach the arm."""
        if not self.is_reachable:
            raise BackendError("The simulated arm does not answer.")

    def read(self) -> ArmReading:
        """The state at this moment; the last one while it is silent."""
        if self.is_silent and self._last is not None:
            return self._last
        self._move()
        self._last = ArmReading(
            time_s=self._clock.now(),
            joints=self._joints.copy(),
            velocities=self._velocities.copy(),
            torques=np.zeros(ARM_JOINTS),
            is_tracking=self._is_tracking,
            fault=self._fault,
            state={"q": self._joints.copy(), "dq": self._velocities.copy()},
        )
        return self._last

    def start(self) -> None:
        """Hold the joints and follow commands."""
        if self._fault is not None:
            raise BackendError(f"The arm cannot start: {self._fault.text}")
        self._move()
        self._target, self._speed = self._joints.copy(), np.zeros(ARM_JOINTS)
        self._is_tracking = True

    def command(self, joints: Array, velocities: Array) -> None:
        """Track a point of a path; nothing is said if it cannot, as with the real one."""
        self.commands += 1
        self._move()
        if self._is_tracking:
            self._target, self._speed = joints.copy(), velocities.copy()

    def stop(self) -> None:
        """Come to rest where it is."""
        self._move()
        self._is_tracking = False

    def recover(self) -> None:
        """Clear a fault."""
        self._fault = None

    def close(self) -> None:
        """Stop."""
        self.stop()

    def fail(self, text: str = "cartesian_reflex", kind: FaultKind = FaultKind.CONTACT) -> None:
        """Report a fault from now on, and follow no more commands."""
        self.stop()
        self._fault = kind.fault(text)

    def put(self, joints: Array) -> None:
        """Put the arm elsewhere, as a person does who leads it by hand."""
        self._move()
        self._joints = np.array(joints, dtype=np.float64)
        self._velocities = np.zeros(ARM_JOINTS)
        self._target = self._joints.copy()

    def _move(self) -> None:
        now = self._clock.now()
        while self._time < now:
            end = min(now, self._time + STEP_S)
            dt, self._time = end - self._time, end
            pull, speed = 0.0, 0.0
            if self._is_tracking:
                pull, speed = (
                    ARM_RATE * ARM_RATE * (self._target - self._joints),
                    self._speed,
                )
            push = 2.0 * ARM_RATE * (speed - self._velocities)
            self._velocities = self._velocities + dt * (pull + push)
            self._joints = self._joints + dt * self._velocities


class SimulatedGripper:
    """A gripper whose fingers move at a finite speed, from an opening of 0 closed to 1 open."""

    is_computed = True

    def __init__(self, _config: GripperConfig, clock: Clock) -> None:
        self._clock = clock
        self._opening = self._target = 1.0
        self._time = clock.now()
        self._last: GripperReading | None = None
        self._fault: Fault | None = None
        self.is_silent = False
        self.is_active = True
        self.object_opening: float | None = None
        """Opening at which the fingers meet an object, if there is one between them."""

    def connect(self) -> None:
        """Reach the gripper."""

    def activate(self) -> None:
        """Become active."""
        self.is_active = True

    def recover(self) -> None:
        """Nothing has to be forgotten."""

    def read(self) -> GripperReading:
        """The state at this moment; the last one, and then a fault, while it is silent."""
        now = self._clock.now()
        if self.is_silent and self._last is not None:
            age = now - self._last.time_s
            if age > SILENCE_S:
                text = f"The gripper has not answered for {age:.2f} s."
                return replace(self._last, fault=FaultKind.COMMUNICATION.fault(text))
            return self._last
        self._move()
        self._last = GripperReading(
            time_s=now,
            opening=self._opening,
            is_active=self.is_active,
            has_object=self._opening == self.object_opening,
            fault=self._fault,
        )
        return self._last

    def command(self, opening: float) -> None:
        """Go to an opening."""
        self._move()
        self._target = min(max(opening, 0.0), 1.0)

    def hold(self) -> None:
        """Stay where the fingers are."""
        self._move()
        self._target = self._opening

    def close(self) -> None:
        """Let go of the device."""

    def fail(self, fault: Fault | None) -> None:
        """Report a fault from now on; None clears it."""
        self._fault = fault

    def _move(self) -> None:
        now = self._clock.now()
        most = GRIPPER_SPEED * (now - self._time)
        self._time = now
        moved = self._opening + min(max(self._target - self._opening, -most), most)
        if self.object_opening is not None and self._opening >= self.object_opening > moved:
            moved = self.object_opening
        self._opening = moved


class SimulatedCamera(TickedCamera):
    """A camera of which every image shows its number, or what a source gives.

    The source gives the image (720, 1280, 3) of a number and a time.
    """

    is_computed = True

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        name: str,
        source: Callable[[int, float], Image] | None = None,
    ) -> None:
        super().__init__(config, clock, name)
        self._source = source or numbered_image
        self._fault: Fault | None = None
        self.is_silent = False
        """Whether it takes no more images, while its count goes on."""

    @property
    def fault(self) -> Fault | None:
        """What is wrong; silence is a fault too."""
        return self._fault or super().fault

    def fail(self, fault: Fault | None) -> None:
        """Report a fault from now on; None clears it."""
        self._fault = fault

    def _image(self, index: int) -> Image | None:
        return None if self.is_silent else self._source(index, self.clock.now())


ARM, GRIPPER, CAMERA = (
    f"{__name__}:{kind.__name__}" for kind in (SimulatedArm, SimulatedGripper, SimulatedCamera)
)
"""Names of the drivers in a rig's file."""


def simulated_rig(changed: Sequence[Side] = SIDES, **changes: Any) -> Rig:
    """A rig of simulated devices alone, whose arms may be as fast as any.

    Changes are fields of both arms, or of some.
    """
    arms = {
        side: ArmConfig(
            driver=ARM,
            address=str(side),
            speed_fraction=MAX_SPEED_FRACTION,
            acceleration=MAX_ACCELERATION,
            tool_speed=MAX_TOOL_SPEED,
        )
        for side in SIDES
    }
    arms |= {side: replace(arms[side], **changes) for side in changed}
    return Rig(
        name="simulated",
        arms=arms,
        grippers=dict.fromkeys(SIDES, GripperConfig(driver=GRIPPER)),
        cameras=dict.fromkeys(POLICY_CAMERAS, CameraConfig(driver=CAMERA)),
    )


def simulated_file(folder: Path) -> Path:
    """The file of a simulated rig, written into a folder."""
    path = folder / "rig.json"
    simulated_rig().write(path)
    return path


def numbered_image(index: int, _time_s: float = 0.0) -> Image:
    """An image (720, 1280, 3) that shows a number as white and black squares along its top."""
    image = _BACKGROUND.copy()
    digits = index >> np.arange(MARKS) & 1
    image[:MARK, : MARKS * MARK] = np.repeat(255 * digits, MARK)[:, None]
    return image


def _background() -> Image:
    """A gentle colour gradient, so that a wrong orientation or order of colours shows."""
    image = np.empty((NATIVE_HEIGHT, NATIVE_WIDTH, 3), dtype=np.uint8)
    image[..., 0] = np.linspace(40, 220, NATIVE_WIDTH).astype(np.uint8)
    image[..., 1] = np.linspace(220, 40, NATIVE_HEIGHT).astype(np.uint8)[:, None]
    image[..., 2] = 90
    return image


_BACKGROUND = _background()
