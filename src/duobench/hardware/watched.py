"""A rig of devices that is watched: connecting, holding, and what everything says.

A fault of any device holds both arms. What can be wrong is asked a hundred times a second, whether
or not somebody sends commands, because an arm that has stopped by itself raises nothing.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping, Sequence

import numpy as np

from duobench.backend import Image
from duobench.errors import BackendError, UnknownNameError, escaped
from duobench.hardware import health
from duobench.hardware.canonical import CanonicalView
from duobench.hardware.clock import Clock, Ticker
from duobench.hardware.devices import (
    Arm,
    ArmReading,
    Camera,
    Fault,
    FaultKind,
    Frame,
    Gripper,
    GripperReading,
)
from duobench.hardware.guard import Guard
from duobench.hardware.motion.drive import Drive
from duobench.hardware.motion.follower import PERIOD
from duobench.hardware.rig import Rig
from duobench.hardware.supervisor import State, Supervisor
from duobench.robot.frames import tcp_poses
from duobench.types import SIDES, Array, DuoState, Side

_log = logging.getLogger(__name__)

WATCH_HZ = 100.0
"""How often a second everything is asked whether it is well."""
STOP_AFTER_S = 30.0
"""Seconds without a command after which the arms stop, damped, instead of holding."""
REST_S = 1.0
"""Longest time in seconds that arms are given to come to rest before they stop, damped."""


class WatchedRig:
    """Devices of a rig, connected and watched, which hold together."""

    def __init__(
        self,
        rig: Rig,
        clock: Clock,
        *,
        arms: Mapping[Side, Arm],
        grippers: Mapping[Side, Gripper],
        cameras: Mapping[str, Camera],
        guard: Guard | None = None,
    ) -> None:
        """Put a rig together; nothing is connected yet. `open_rig` does this from a rig's file.

        Args:
            rig: What the rig's file says.
            clock: Who calls followers and the watch.
            arms: Both arms.
            grippers: Both grippers.
            cameras: Cameras by name.
            guard: Who keeps the arms apart, and off the table; None leaves that to people.
        """
        self.rig, self.clock = rig, clock
        self.arms, self.grippers, self.cameras = dict(arms), dict(grippers), dict(cameras)
        self.supervisor = Supervisor(clock.now, self._recover)
        self.guard = guard
        self._drive = Drive(self.arms, self.grippers, rig.arms, clock)
        self._motion = threading.RLock()  # between who moves the arms and who holds them
        self._watch: Ticker | None = None
        self._last_heard = 0.0
        self._views: dict[str, CanonicalView] = {}
        self._state: DuoState | None = None
        self._velocities = np.zeros((2, 7))
        self._time = 0.0

    # --- connecting ------------------------------------------------------------------------------

    def start(self) -> None:
        """Connect everything; nothing moves. Twice is harmless.

        Raises:
            BackendError: A device cannot be reached; then none is connected.
        """
        if self.supervisor.state is not State.OFF:
            return
        connected: list[Arm | Gripper | Camera] = []
        try:
            devices = (*self.arms.values(), *self.grippers.values(), *self.cameras.values())
            for device in devices:
                connected.append(device)
                device.connect()
            self._measure()
        except BackendError:
            for device in connected:
                device.close()
            raise
        self.supervisor.enter(State.CONNECTED)
        self._last_heard = self.clock.now()
        self._watch = self.clock.every(1.0 / WATCH_HZ, self.watch, "watch")

    def stop(self) -> None:
        """Come to rest, then stop damped; the operator has to confirm before anything moves."""
        if self.supervisor.state is State.OFF:
            return
        with self._motion:
            moving = (State.HOMING, State.READY, State.RUNNING)
            self.supervisor.enter(State.CONNECTED, only_from=moving)
            self.supervisor.revoke()
            self._drive.hold()
        end = self.clock.now() + REST_S
        while self._drive.is_engaged and not self._drive.is_at_rest and self.clock.now() < end:
            self.clock.wait_until(self.clock.now() + PERIOD)
        self._drive.disengage()

    def close(self) -> None:
        """Stop, and let go of everything; closing twice is harmless."""
        self.stop()
        watch, self._watch = self._watch, None
        if watch is not None:
            watch.stop()
        for device in (*self.arms.values(), *self.grippers.values(), *self.cameras.values()):
            device.close()
        if self.supervisor.state is not State.OFF:
            self.supervisor.enter(State.OFF)
        if self.guard is not None:
            self.guard.close()

    # --- holding ---------------------------------------------------------------------------------

    def hold(self, reason: str) -> None:
        """Bring both arms to rest and hold them there; a person's word, or a program's."""
        self._hold(reason)

    def _hold(self, reason: str, fault: Fault | None = None) -> None:
        with self._motion:
            if not self.supervisor.hold(reason, fault):
                return
            self._last_heard = self.clock.now()
            self._drive.hold()

    @property
    def held(self) -> str | None:
        """Why the arms are held; None while they follow commands."""
        return self.supervisor.reason

    @property
    def fault(self) -> Fault | None:
        """What is wrong; None while nothing is."""
        return self.supervisor.fault

    def health(self) -> str | None:
        """What is wrong, in words; both arms are then held already."""
        self._check()
        fault = self.supervisor.fault
        return None if fault is None else fault.text

    def watch(self) -> None:
        """Ask whether everything is well; the clock calls this a hundred times a second."""
        try:
            self._check()
        except Exception as error:  # noqa: BLE001 - whatever it is, nobody watches the arms then
            _log.exception("The watch failed.")
            text = f"What is wrong cannot be told: {escaped(repr(error))}"
            self._hold(text, Fault(kind=FaultKind.DEVICE, text=text))
        now, state = self.clock.now(), self.supervisor.state
        if not self._drive.is_engaged or state in {State.HOMING, State.READY}:
            return
        if now - self._last_heard > STOP_AFTER_S:
            if state is State.RUNNING:
                self._hold(f"No command came for {STOP_AFTER_S:g} s; the arms were stopped.")
            self._drive.disengage()

    def _check(self) -> None:
        """Hold both arms where something is wrong."""
        if self.supervisor.state in {State.OFF, State.FAULTED, State.RECOVERING}:
            return
        fault = self._find_fault()
        if fault is not None:
            self._hold(fault.text, fault)

    def _find_fault(self) -> Fault | None:
        is_running = self.supervisor.state is State.RUNNING
        return (
            health.arm_fault(
                self.arms, self._drive.leaders, self.clock, is_engaged=self._drive.is_engaged
            )
            or health.gripper_fault(self.grippers, self.clock)
            or health.camera_fault(self.cameras, self.clock, is_running=is_running)
        )

    def _recover(self) -> None:
        """Clear the faults of all devices, at the operator's word; nothing moves."""
        self._drive.disengage()
        for arm in self.arms.values():
            arm.recover()
        fault = self._find_fault()
        if fault is not None:
            raise BackendError(f"The rig is not well yet: {fault.text}")

    # --- asking ----------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Seconds on the rig's clock when the latest state was measured."""
        return self._time

    def read(self) -> DuoState:
        """The state that was measured last."""
        if self._state is None:
            raise BackendError("The rig is not started.")
        return self._state

    def joint_velocities(self) -> Array:
        """Joint velocities (2, 7) in rad/s, left then right, measured last."""
        return self._velocities.copy()

    def readings(self) -> dict[Side, ArmReading]:
        """What both arms say at this moment."""
        return {side: self.arms[side].read() for side in SIDES}

    def gripper_readings(self) -> dict[Side, GripperReading]:
        """What both grippers say at this moment."""
        return {side: self.grippers[side].read() for side in SIDES}

    def _measure(self) -> None:
        readings, grippers = self.readings(), self.gripper_readings()
        joints = np.array([readings[side].joints for side in SIDES])
        self._velocities = np.array([readings[side].velocities for side in SIDES])
        openings = np.array([grippers[side].opening for side in SIDES])
        self._state = DuoState(joints=joints, openings=openings, tcp_poses=tcp_poses(joints))
        self._time = self.clock.now()

    # --- images ----------------------------------------------------------------------------------

    def frames(self) -> dict[str, Frame]:
        """The latest frame of each camera that has one, as it came from it."""
        return health.frames(self.cameras)

    def image_ages(self) -> dict[str, float]:
        """Seconds since the latest image of each camera was taken; infinite without one."""
        return health.image_ages(self.cameras, self.clock.now())

    def images(self, cameras: Sequence[str], shape: tuple[int, int]) -> dict[str, Image]:
        """The latest image of each of some cameras, as the simulation's camera would see it.

        Raises:
            UnknownNameError: The rig has no such camera.
            BackendError: A camera has given no image yet.
        """
        frames, images = self.frames(), {}
        for name in cameras:
            if name not in self.cameras:
                raise UnknownNameError("camera of this rig", name, self.cameras)
            if name not in frames:
                raise BackendError(f"The camera {name} has given no image yet.")
            if name not in self._views:
                config = self.rig.cameras[name]
                self._views[name] = CanonicalView(name, config.calibration, config.size)
            images[name] = self._views[name].image(frames[name].image, shape)
        return images
