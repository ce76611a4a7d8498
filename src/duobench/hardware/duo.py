"""Two real arms with grippers and cameras as a `DuoBackend`.

A fault of any device holds both arms. What can be wrong is asked a hundred times a second, whether
or not somebody sends commands, because an arm that has stopped by itself raises nothing.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence

import numpy as np

from duobench.backend import DuoLimits, Image
from duobench.envs.duo_env import MAX_IMAGE_AGE_SECONDS
from duobench.errors import ActionError, BackendError, UnknownNameError
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
from duobench.hardware.follower import PERIOD, RANGE_MARGIN, Follower, MotionLimits
from duobench.hardware.guard import Guard
from duobench.hardware.leader import Leader
from duobench.hardware.rig import Rig
from duobench.hardware.supervisor import HELD, State, Supervisor
from duobench.robot.joints import HOME_JOINTS, VELOCITY_LIMITS
from duobench.robot.kinematics import tcp_poses
from duobench.robot.limits import duo_limits
from duobench.types import SIDES, Array, DuoCommand, DuoState, Side

WATCH_HZ = 100.0
"""How often a second everything is asked whether it is well."""
MAX_ARM_AGE_S = 0.1
"""Oldest reading of an arm that it is moved by, in seconds."""
MAX_GRIPPER_AGE_S = 0.5
"""Oldest reading of a gripper, in seconds; one that is told nothing new answers at 30 Hz."""
MAX_FREEZE_S = 0.2
"""Longest time in seconds that an arm may be told nothing: this process was stopped."""
STOP_AFTER_S = 30.0
"""Seconds without a command after which the arms stop, damped, instead of holding."""
HOME_TOLERANCE = 0.03
"""How near in radians a joint has to be home, which an arm with a soft grip on its joints may miss
by a little."""
SETTLE_S = 5.0
"""Seconds that arms may take to come to rest, and grippers to open."""
OPEN = 0.9
"""Opening from which a gripper counts as open."""


class HardwareDuo:
    """A `DuoBackend` over devices of a rig.

    `start` connects, and moves nothing. Before anything moves the operator has to confirm
    (`supervisor.confirm`): then `home` goes home slowly, or `command` moves on from where the arms
    are. A fault holds both arms until the operator recovers them (`supervisor.recover`).
    """

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
        configs = [rig.arms[side] for side in SIDES]
        left, right = (config.speed_fraction for config in configs)
        self._nominal = duo_limits()
        self._limits = duo_limits((left, right), RANGE_MARGIN)
        self._accelerations = np.array([[config.acceleration] for config in configs])
        self._leaders = {
            side: Leader(
                self.arms[side], Follower(HOME_JOINTS[side.index], MotionLimits.of(config)), clock
            )
            for side, config in zip(SIDES, configs, strict=True)
        }
        self._motion = threading.RLock()  # between who moves the arms and who holds them
        self._watch: Ticker | None = None
        self._is_engaged = False
        self._last_heard = 0.0
        self._due = 0.0
        self._late = 0.0
        self._last: DuoCommand | None = None
        self._state: DuoState | None = None
        self._velocities = np.zeros((2, 7))
        self._time = 0.0

    # --- connecting ------------------------------------------------------------------------------

    def start(self) -> None:
        """Connect everything; nothing moves. Twice is harmless."""
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
        self._last = self._here()
        self._last_heard = self.clock.now()
        self._watch = self.clock.every(1.0 / WATCH_HZ, self.watch, "watch")

    def stop(self) -> None:
        """Come to rest, then stop damped; the operator has to confirm before anything moves."""
        if self.supervisor.state is State.OFF:
            return
        with self._motion:
            for leader in self._leaders.values():
                leader.hold()
            for gripper in self.grippers.values():
                gripper.hold()
            self.supervisor.revoke()
        end = self.clock.now() + 1.0
        while self._is_engaged and not self._is_at_rest() and self.clock.now() < end:
            self.clock.wait_until(self.clock.now() + PERIOD)
        self._disengage()
        self.supervisor.enter(State.CONNECTED, only_from=(State.HOMING, State.READY, State.RUNNING))

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
            for leader in self._leaders.values():
                leader.hold()
            for gripper in self.grippers.values():
                gripper.hold()

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
        self._check()
        now, state = self.clock.now(), self.supervisor.state
        if not self._is_engaged or state in {State.HOMING, State.READY}:
            return
        if now - self._last_heard > STOP_AFTER_S:
            if state is State.RUNNING:
                self._hold(f"No command came for {STOP_AFTER_S:g} s; the arms were stopped.")
            self._disengage()

    def _check(self) -> None:
        """Hold both arms where something is wrong."""
        if self.supervisor.state in {State.OFF, State.FAULTED, State.RECOVERING}:
            return
        fault = self._find_fault()
        if fault is not None:
            self._hold(fault.text, fault)

    def _find_fault(self) -> Fault | None:
        for find in (self._arm_fault, self._gripper_fault, self._camera_fault):
            fault = find()
            if fault is not None:
                return fault
        return None

    def _arm_fault(self) -> Fault | None:
        now = self.clock.now()
        for side, arm in self.arms.items():
            reading = arm.read()
            if reading.fault is not None:
                return _named(f"The {side} arm", reading.fault)
            if (age := now - reading.time_s) > MAX_ARM_AGE_S:
                return _lost(f"The {side} arm has given no reading for {age:.2f} s.")
            if not self._is_engaged:
                continue
            if not reading.is_tracking:
                text = f"The {side} arm follows no more commands, and says nothing about why."
                return Fault(kind=FaultKind.DEVICE, text=text)
            if (late := self._leaders[side].take_lateness()) > MAX_FREEZE_S:
                return _lost(f"This computer stood still for {late:.2f} s.")
            if (error := self._leaders[side].error) is not None:
                return _lost(f"The {side} arm cannot be told where to be: {error}")
        return None

    def _gripper_fault(self) -> Fault | None:
        now = self.clock.now()
        for side, gripper in self.grippers.items():
            reading = gripper.read()
            if reading.fault is not None:
                return _named(f"The {side} gripper", reading.fault)
            if (age := now - reading.time_s) > MAX_GRIPPER_AGE_S:
                return _lost(f"The {side} gripper has not answered for {age:.2f} s.")
        return None

    def _camera_fault(self) -> Fault | None:
        for name, camera in self.cameras.items():
            if camera.fault is not None:
                return _named(f"The camera {name}", camera.fault)
        if self.supervisor.state is not State.RUNNING:
            return None
        for name, age in self.image_ages().items():
            if not age <= MAX_IMAGE_AGE_SECONDS:
                return _lost(
                    f"The latest image of the camera {name} is {age:.2f} s old; at most "
                    f"{MAX_IMAGE_AGE_SECONDS:g} s is right."
                )
        return None

    def _recover(self) -> None:
        """Clear the faults of all devices, at the operator's word; nothing moves."""
        self._disengage()
        for arm in self.arms.values():
            arm.recover()
        fault = self._find_fault()
        if fault is not None:
            raise BackendError(f"The rig is not well yet: {fault.text}")

    # --- moving ----------------------------------------------------------------------------------

    def home(self) -> None:
        """Go home slowly on a way that the guard found free, and open the grippers.

        Raises:
            BackendError: The operator has not confirmed, no free way was found, or something went
                wrong on the way; then both arms are held.
        """
        self.start()
        self.supervisor.check_confirmed()
        self._measure()
        here = self._here().joints
        way = [HOME_JOINTS] if self.guard is None else self.guard.way(here, HOME_JOINTS)
        self.supervisor.begin(State.HOMING)
        self._engage()
        self._due = self.clock.now()
        for start, end in zip([here, *way[:-1]], way, strict=True):
            self._go(start, end)
        for gripper in self.grippers.values():
            gripper.command(1.0)
        self._last = DuoCommand(joints=HOME_JOINTS.copy(), openings=np.ones(2))
        self._settle()
        if not self.supervisor.enter(State.READY, only_from=(State.HOMING,)):
            raise BackendError(f"The arms did not get home: {self.held}")

    def _go(self, start: Array, end: Array) -> None:
        """Lead both arms along a straight line in joint space, as slowly as the rig says."""
        fractions = np.array([[self.rig.arms[side].home_fraction] for side in SIDES])
        per_step = fractions * np.array(VELOCITY_LIMITS) * PERIOD
        steps = max(1, int(np.ceil(np.max(np.abs(end - start) / per_step))))
        for step in range(1, steps + 1):
            self._aim(start + (end - start) * (step / steps))
            self._tick()

    def _aim(self, joints: Array) -> None:
        with self._motion:
            if (reason := self.held) is not None:
                raise BackendError(f"The arms did not get home: {reason}")
            for side, leader in self._leaders.items():
                leader.aim(joints[side.index])

    def _settle(self) -> None:
        """Wait until both arms are at rest at home with open grippers."""
        end = self.clock.now() + SETTLE_S
        while True:
            self._tick()
            if (reason := self.held) is not None:
                raise BackendError(f"The arms did not get home: {reason}")
            here = self._here()
            off = float(np.max(np.abs(here.joints - HOME_JOINTS)))
            if off <= HOME_TOLERANCE and here.openings.min() >= OPEN and self._is_at_rest():
                return
            if self.clock.now() > end:
                text = (
                    f"The arms are {off:.3f} rad from home and the grippers open to "
                    f"{here.openings.min():.2f}, {SETTLE_S:g} s after they should be there."
                )
                self._hold(text, Fault(kind=FaultKind.DEVICE, text=text))
                raise BackendError(text)

    def command(self, command: DuoCommand) -> DuoCommand:
        """Move towards a command until the next tick of the control rate.

        Returns:
            What was really sent: within the rig's limits, and the last command while the arms are
            held.

        Raises:
            ActionError: It holds NaN or infinity. Nothing was moved.
            BackendError: The operator has not confirmed, or the rig is not started.
        """
        targets = command.flat
        if not np.isfinite(targets).all():
            raise ActionError(f"A command is finite, got {targets.tolist()}. Nothing was moved.")
        self._begin()
        self._late = max(0.0, self.clock.now() - self._due) if self._due else 0.0
        self._check()
        if self.held is None:
            self._send(targets)
        self._tick()
        return self.last_command

    def _begin(self) -> None:
        """Follow commands from now on, if that is allowed."""
        state = self.supervisor.state
        if state in HELD or state is State.RUNNING:
            return
        if state in {State.OFF, State.HOMING}:
            raise BackendError(f"Commands are followed after start and home; the rig is {state}.")
        self.supervisor.check_confirmed()
        if not self._is_engaged:
            self._measure()
            self._engage()
            self._due = self.clock.now()
        self._last_heard = self.clock.now()
        self.supervisor.begin(State.RUNNING)

    def _send(self, targets: Array) -> None:
        last = self.last_command
        sent = DuoCommand.from_flat(self._limits.clip(targets, last.flat))
        if self.guard is not None:
            problem = self.guard.problem(sent.joints) or self.guard.problem(
                self._stopping(last.joints, sent.joints)
            )
            if problem is not None:
                text = f"The guard refused a command: {problem}"
                self._hold(text, Fault(kind=FaultKind.REFLEX, text=text))
                return
        with self._motion:
            if self.held is not None:
                return
            for side, leader in self._leaders.items():
                leader.aim(sent.joints[side.index])
                self.grippers[side].command(float(sent.openings[side.index]))
            self._last, self._last_heard = sent, self.clock.now()

    def _stopping(self, last: Array, target: Array) -> Array:
        """Where the arms come to rest that brake at a target."""
        speeds = (target - last) / PERIOD
        return target + speeds * np.abs(speeds) / (2.0 * self._accelerations)

    def _engage(self) -> None:
        """Have the arms track their followers, from where they are."""
        if self._is_engaged:
            return
        started: list[Arm] = []
        try:
            for side, arm in self.arms.items():
                started.append(arm)
                arm.start()
                self._leaders[side].start(arm.read().joints)
        except BackendError as error:
            for leader in self._leaders.values():
                leader.stop()
            for arm in started:
                arm.stop()
            self._hold(str(error), Fault(kind=FaultKind.DEVICE, text=str(error)))
            raise
        self._is_engaged = True
        self._last_heard = self.clock.now()
        self._last = self._here()

    def _disengage(self) -> None:
        """Have the arms stop, damped."""
        with self._motion:
            was, self._is_engaged = self._is_engaged, False
        if was:
            for leader in self._leaders.values():
                leader.stop()
            for arm in self.arms.values():
                arm.stop()

    def _is_at_rest(self) -> bool:
        return all(leader.is_at_rest for leader in self._leaders.values())

    def _tick(self) -> None:
        """Wait for the next tick of the control rate, and measure."""
        now = self.clock.now()
        # A step that takes too long leaves out ticks; the grid stays.
        self._due += PERIOD * max(1, math.ceil((now - self._due) / PERIOD))
        self.clock.wait_until(self._due)
        self._measure()

    # --- asking ----------------------------------------------------------------------------------

    @property
    def limits(self) -> DuoLimits:
        """Those of the simulation, so that spaces are the same; the rig's own are narrower."""
        return self._nominal

    @property
    def last_command(self) -> DuoCommand:
        """The command that was really sent last; before the first one, where the arms are."""
        if self._last is None:
            raise BackendError("The rig is not started.")
        return DuoCommand.from_flat(self._last.flat)

    @property
    def late_s(self) -> float:
        """How many seconds too late the last command came."""
        return self._late

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

    def _here(self) -> DuoCommand:
        state = self.read()
        return DuoCommand(joints=state.joints.copy(), openings=state.openings.copy())

    # --- images ----------------------------------------------------------------------------------

    def frames(self) -> dict[str, Frame]:
        """The latest frame of each camera that has one, as it came from it."""
        latest = {name: camera.latest() for name, camera in self.cameras.items()}
        return {name: frame for name, frame in latest.items() if frame is not None}

    def image_ages(self) -> dict[str, float]:
        """Seconds since the latest image of each camera was taken; infinite without one."""
        now, frames = self.clock.now(), self.frames()
        return {
            name: now - frames[name].time_s if name in frames else float("inf")
            for name in self.cameras
        }

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
            images[name] = _resized(frames[name].image, shape)
        return images


def _resized(image: Image, shape: tuple[int, int]) -> Image:
    from PIL import Image as Pictures

    if image.shape[:2] == shape:
        return image.copy()
    height, width = shape
    picture = Pictures.fromarray(image).resize((width, height), Pictures.Resampling.BOX)
    return np.asarray(picture)


def _named(device: str, fault: Fault) -> Fault:
    return Fault(kind=fault.kind, text=f"{device}: {fault.text}")


def _lost(text: str) -> Fault:
    return Fault(kind=FaultKind.COMMUNICATION, text=text)
