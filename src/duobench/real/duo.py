"""Two real arms with grippers and cameras as a `DuoBackend`: commands in, motion out."""

from __future__ import annotations

import math
import threading
from collections.abc import (
    Callable,
    Iterable,
    Mapping,
    Sequence,
)
from typing import TYPE_CHECKING, Any

import numpy as np

from duobench.core.backend import (
    RGB,
    AnyCamera,
    CameraGeometry,
    Image,
    Sizes,
    Wanted,
)
from duobench.core.errors import ActionError, BackendError, escaped
from duobench.core.spatial import SE3
from duobench.core.types import (
    SIDES,
    Array,
    DuoCommand,
    DuoState,
    Side,
)
from duobench.real.canonical import CanonicalViews
from duobench.real.clock import Clock
from duobench.real.controller import ArmsController
from duobench.real.devices import (
    Arm,
    ArmReading,
    Camera,
    Device,
    Frame,
    Gripper,
    GripperReading,
)
from duobench.real.follower import PERIOD, paced
from duobench.real.guard import Guard
from duobench.real.hands import OPEN, GripperPair
from duobench.real.mounts import SWAPPED, are_swapped
from duobench.real.rig import UNPOSED, Rig
from duobench.real.supervisor import HELD, State, Supervisor
from duobench.real.watchdog import Watchdog
from duobench.real.way_home import path_home, points
from duobench.results.labels import Fault, FaultKind
from duobench.world.robot.camera_geometry import geometries, geometry, mount_pose
from duobench.world.robot.cameras import CAMERAS, MUJOCO_FROM_OPENCV
from duobench.world.robot.frames import Robot
from duobench.world.robot.joints import RANGE_MARGIN, duo_limits

if TYPE_CHECKING:
    from duobench.real.rehearsal import RehearsalWorld
    from duobench.tasks.task import Task
    from duobench.world.sim.layout import Layout

REST_S = 1.0
"""Longest time in seconds that arms are given to come to rest before they stop, damped."""
HOME_TOLERANCE = 0.03
"""Distance from home in radians that counts as home: low gains leave a small error."""
SETTLE_S = 5.0
"""Seconds that arms may take to come to rest, and grippers to open."""


class FrankaDuo:
    """A `DuoBackend` over devices of a rig; `open_rig` makes one from a rig's file.

    `start` connects, and moves nothing. Before anything moves the operator has to confirm
    (`supervisor.confirm`): then `home` goes home slowly, or `command` moves on from where the arms
    are. A fault of any device holds both arms until the operator recovers them
    (`supervisor.recover`). Without a guard it is left to people to keep the arms apart.
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
        world: RehearsalWorld | None = None,
    ) -> None:
        self.rig = rig
        self.robot: Robot = rig.robot
        """Description of the arms."""
        self.clock = clock
        self.guard = guard
        self.arms = dict(arms)
        self.grippers = dict(grippers)
        self.cameras = dict(cameras)
        self.world = world
        """World of a rehearsal; None for all other rigs."""
        self.supervisor = Supervisor(self._recover)
        self.hands = GripperPair(self.grippers, self.supervisor, clock)
        """The grippers, as the operator has them activated and opened."""
        self._controller = ArmsController(
            self.arms, self.grippers, rig.arms, clock, self.robot
        )
        self._watchdog = Watchdog(
            self._controller, self.cameras, self.supervisor, clock, self.hold
        )
        # Between what moves the arms and what holds them.
        self._motion = threading.RLock()
        left, right = (rig.arms[side] for side in SIDES)
        self.limits = duo_limits()
        """Limits of the simulation, so that spaces are the same; the rig's own are narrower."""
        self._limits = duo_limits(
            (left.speed_fraction, right.speed_fraction), RANGE_MARGIN
        )
        self._tool_speeds = left.tool_speed, right.tool_speed
        self._accelerations = np.array([[left.acceleration], [right.acceleration]])
        slow = [[min(arm.home_fraction, arm.speed_fraction)] for arm in (left, right)]
        self._home_fractions = np.array(slow)
        self._due = 0.0
        self.followed = 0
        """Number of commands so far that found arms which were not held."""
        self.late_s = 0.0
        """Seconds by which the last command came too late."""
        self.time = 0.0
        """Seconds on the rig's clock when the latest state was measured."""
        self._last: DuoCommand | None = None
        self._views = CanonicalViews(self.cameras, rig.cameras)
        self._state: DuoState | None = None
        self._velocities = np.zeros((2, 7))

    # --- connecting ------------------------------------------------------------------------------

    def start(self) -> None:
        """Connect everything; nothing moves. Twice is harmless.

        Raises:
            BackendError: A device cannot be reached, or the arms are swapped; then none is
                connected.
        """
        if self.supervisor.state is not State.OFF:
            return
        connected: list[Device] = []
        try:
            for device in self._devices():
                connected.append(device)
                device.connect()
            self._measure()
            if are_swapped(self.readings(), self.robot):
                raise BackendError(SWAPPED)
        except BackendError:
            for device in connected:
                device.close()
            raise
        self.hands.have_grasped = bool(self.read().openings.min() < OPEN)
        self.supervisor.enter(State.CONNECTED)
        self._watchdog.start()
        self._last = self._here()

    def stop(self) -> None:
        """Come to rest, then stop damped; the operator has to confirm before anything moves."""
        if self.supervisor.state is State.OFF:
            return
        with self._motion:
            moving = (State.HOMING, State.READY, State.RUNNING)
            self.supervisor.enter(State.CONNECTED, only_from=moving)
            self.supervisor.revoke()
            self._controller.hold()
        end = self.clock.now() + REST_S
        arms = self._controller
        while arms.is_engaged and not arms.is_at_rest and self.clock.now() < end:
            self.clock.wait_until(self.clock.now() + PERIOD)
        arms.disengage()

    def close(self) -> None:
        """Stop, and let go of everything; closing twice is harmless."""
        self.stop()
        self._watchdog.stop()
        for device in self._devices():
            device.close()
        if self.supervisor.state is not State.OFF:
            self.supervisor.enter(State.OFF)

    def _devices(self) -> tuple[Device, ...]:
        return (*self.arms.values(), *self.grippers.values(), *self.cameras.values())

    def place(self, task: Task, layout: Layout) -> None:
        """Put the objects of a rehearsal where a layout says; elsewhere a person has done it.

        Raises:
            BackendError: An arm or a grip is in the way.
        """
        if self.world is not None:
            self.world.place(task, layout)

    # --- holding ---------------------------------------------------------------------------------

    def hold(self, reason: str, fault: Fault | None = None) -> None:
        """Bring both arms to rest and hold them there; a person's word where there is no fault."""
        with self._motion:
            if self.supervisor.hold(reason, fault):
                self._watchdog.feed()
            self._controller.hold()

    def see(self, cameras: Iterable[str]) -> None:
        """Set the cameras in use while commands are followed; all at first.

        Only their images may not be late then.
        """
        self._watchdog.seen = frozenset(cameras)

    def watch_person(self, look: Callable[[], None]) -> None:
        """Check for a person a hundred times a second while arms or fingers may move.

        `look` holds the arms without a person.
        """
        self._watchdog.look = look

    @property
    def held(self) -> str | None:
        """Reason why the arms are held; None while they follow commands."""
        return self.supervisor.reason

    @property
    def fault(self) -> Fault | None:
        """Current fault; None without one."""
        return self.supervisor.fault

    def health(self) -> str | None:
        """Return the current fault in words; both arms are then held already.

        Where an image is late the arms come to rest, and it is waited for.
        """
        if self._watchdog.wait_for_images():
            self._due = self.clock.now()
            self._measure()
        self._watchdog.check()
        fault = self.supervisor.fault
        return None if fault is None else fault.text

    def _recover(self) -> None:
        """Clear the faults of all devices, at the operator's word; nothing moves."""
        self._controller.disengage()
        for device in (
            *self.arms.values(),
            *self.grippers.values(),
            *self.cameras.values(),
        ):
            device.recover()
        fault = self._watchdog.find_fault()
        if fault is not None:
            raise BackendError(f"The rig is not well yet: {fault.text}")

    # --- going home ------------------------------------------------------------------------------

    def home(self, *, with_object: bool = False) -> None:
        """Come to rest, go home slowly on a path that the guard found free, and open the grippers.

        What one hand holds is carried home if `with_object` says so, and let go there.

        Raises:
            BackendError: The operator has not confirmed, a gripper is not active, the hands hold
                something, no free path was found, or something went wrong on the way; then both
                arms are held.
        """
        self.start()
        self.supervisor.check_confirmed()
        self.hands.check_active()
        self.hands.check_free(with_object=with_object)
        self._rest()
        path = self.path_home()
        here = self.read().joints
        self.supervisor.begin(State.HOMING)
        self._engage()
        self._controller.limit(is_home=True)
        self._due = self.clock.now()
        for start, end in zip([here, *path[:-1]], path, strict=True):
            self._go(start, end)
        for gripper in self.grippers.values():
            gripper.command(1.0)
        self._last = DuoCommand(joints=self.robot.home.copy(), openings=np.ones(2))
        self._settle()
        self._controller.limit(is_home=False)
        if not self.supervisor.enter(State.READY, only_from=(State.HOMING,)):
            raise BackendError(f"The arms did not get home: {self.held}")
        self.hands.have_grasped = False

    def path_home(self) -> list[Array]:
        """The path that `home` takes from where the arms are; see `way_home.path_home`."""
        self._measure()
        retreats = self.hands.have_grasped and not self.hands.holding
        return path_home(self.guard, self.read().joints, self.robot, retreats=retreats)

    def _rest(self) -> None:
        """Wait until arms that still move are at rest where they are."""
        self._controller.hold()
        end = self.clock.now() + SETTLE_S
        self._due = self.clock.now()
        while self._controller.is_engaged and not self._controller.is_at_rest:
            self._tick()
            self.supervisor.check_confirmed()  # a hold takes it back
            if self.clock.now() > end:
                raise BackendError(
                    "The arms did not get home: they do not come to rest."
                )

    def _go(self, start: Array, end: Array) -> None:
        """Lead both arms along a straight line in joint space, as slowly as the rig says."""
        for point in points(
            start, end, self._home_fractions, self._tool_speeds, self.robot
        ):
            with self._motion:
                if self.supervisor.state is not State.HOMING:
                    reason = self.held or "they were stopped"
                    raise BackendError(f"The arms did not get home: {reason}")
                self._controller.aim(point)
                self._watchdog.feed()
            self._tick()

    def _settle(self) -> None:
        """Wait until both arms are at rest at home with open grippers."""
        end = self.clock.now() + SETTLE_S
        while True:
            self._tick()
            reason = self.held
            if reason is not None:
                raise BackendError(f"The arms did not get home: {reason}")
            here = self._here()
            off = float(np.max(np.abs(here.joints - self.robot.home)))
            is_open = here.openings.min() >= OPEN
            if off <= HOME_TOLERANCE and is_open and self._controller.is_at_rest:
                return
            if self.clock.now() > end:
                text = (
                    f"The arms are {off:.3f} rad from home and the grippers open to "
                    f"{here.openings.min():.2f}, {SETTLE_S:g} s after they should be there."
                )
                self.hold(text, FaultKind.CONTROLLER.fault(text))
                raise BackendError(text)

    # --- commands --------------------------------------------------------------------------------

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
            raise ActionError(
                f"A command is finite, got {targets.tolist()}. Nothing was moved."
            )
        self._begin()
        self.late_s = max(0.0, self.clock.now() - self._due - PERIOD)
        if self.health() is None and self.held is None:
            self.followed += 1
            self._send(targets)
        self._tick()
        return self.last_command

    def _begin(self) -> None:
        state = self.supervisor.state
        if state in HELD or state is State.RUNNING:
            return
        if state in {State.OFF, State.HOMING}:
            raise BackendError(
                f"Commands are followed after start and home; the rig is {state}."
            )
        self.supervisor.check_confirmed()
        self.hands.check_active()
        if not self._controller.is_engaged:
            self._measure()
            self._engage()
        self._watchdog.feed()
        self._due = self.clock.now()
        self._controller.limit(is_home=False)
        self.supervisor.begin(State.RUNNING)

    def _send(self, targets: Array) -> None:
        last = self.last_command
        within = self._limits.clip(
            targets, last.flat, self.read().flat, self._velocities
        )
        sent = paced(last, DuoCommand.from_flat(within), self._tool_speeds, self.robot)
        fault = self._guard_fault(last.joints, sent.joints)
        if fault is not None:
            self.hold(fault.text, fault)
            return
        with self._motion:
            if self.supervisor.state is not State.RUNNING:
                return
            self._controller.send(sent)
            self.hands.have_grasped |= bool(sent.openings.min() < OPEN)
            self._last = sent
            self._watchdog.feed()

    def _guard_fault(self, last: Array, target: Array) -> Fault | None:
        """Reason why the guard rejects a command; None if it accepts it."""
        if self.guard is None:
            return None
        # Where arms come to rest that brake at the target.
        speeds = (target - last) / PERIOD
        rest = target + speeds * np.abs(speeds) / (2.0 * self._accelerations)
        try:
            problem = self.guard.problem(target) or self.guard.problem(rest)
        except Exception as error:  # noqa: BLE001 - after any error the arms are unwatched
            return FaultKind.CONTROLLER.fault(
                f"The guard failed: {escaped(repr(error))}"
            )
        if problem is None:
            return None
        return FaultKind.CONTACT.fault(f"The guard refused a command: {problem}")

    def _engage(self) -> None:
        """Let the arms track their followers, from where they are."""
        if self._controller.is_engaged:
            return
        try:
            self._controller.engage()
        except BackendError as error:
            self.hold(str(error), FaultKind.CONTROLLER.fault(str(error)))
            raise
        self._watchdog.feed()
        self._due = self.clock.now()
        self._last = self._here()

    def _tick(self) -> None:
        """Wait for the next tick of the control rate, and measure."""
        now = self.clock.now()
        # A step that takes too long leaves out ticks; the grid stays.
        self._due += PERIOD * max(1, math.ceil((now - self._due) / PERIOD))
        self.clock.wait_until(self._due)
        self._measure()

    @property
    def last_command(self) -> DuoCommand:
        """The command that was really sent last; before the first one, where the arms are."""
        if self._last is None:
            raise BackendError("The rig is not started.")
        return DuoCommand.from_flat(self._last.flat)

    # --- readings --------------------------------------------------------------------------------

    def read(self) -> DuoState:
        """Latest measured state."""
        if self._state is None:
            raise BackendError("The rig is not started.")
        return self._state

    def joint_velocities(self) -> Array:
        """Joint velocities (2, 7) in rad/s, left then right, measured last."""
        return self._velocities.copy()

    def readings(self) -> dict[Side, ArmReading]:
        """Read both arms."""
        return {side: self.arms[side].read() for side in SIDES}

    def gripper_readings(self) -> dict[Side, GripperReading]:
        """Read both grippers."""
        return {side: self.grippers[side].read() for side in SIDES}

    def frames(self) -> dict[str, Frame]:
        """Latest frame of each camera that has one, unchanged."""
        latest = {name: camera.latest() for name, camera in self.cameras.items()}
        return {name: frame for name, frame in latest.items() if frame is not None}

    @property
    def waits(self) -> int:
        """Number of times that the arms rested and waited for a late image."""
        return self._watchdog.waits

    def image_ages(self) -> dict[str, float]:
        """Seconds since the latest image of each camera that is seen; infinite without one."""
        return self._watchdog.image_ages()

    def images(
        self, cameras: Sequence[str | AnyCamera], shape: tuple[int, int]
    ) -> dict[str, Image]:
        """The latest image of each of some cameras, as the simulation's camera would see it.

        Raises:
            UnknownNameError: The rig has no such camera.
            BackendError: A camera has given no image yet.
        """
        wanted = {RGB: dict.fromkeys(cameras, shape)}
        return self._views.images(wanted)[RGB]

    def images_by_kind(self, wanted: Wanted) -> dict[str, dict[str, Any]]:
        """Latest images of several kinds, as the simulation's cameras would see them.

        Raises:
            UnknownNameError: The rig has no such camera.
            BackendError: A camera gives no images of that kind, or has given none yet.
        """
        return self._views.images(wanted)

    def camera_geometry(self, sizes: Sizes) -> dict[str, CameraGeometry]:
        """Lens of canonical images, and place of each camera as it was measured, or is built."""
        tools = self.read().tcp_poses
        found = geometries(sizes, tools, self.robot.gripper)
        for name, each in found.items():
            measured = self.rig.cameras[name].calibration
            if measured is not None and measured.pose != UNPOSED:
                pose = SE3.from_tquat(np.array(measured.pose))
                mount = mount_pose(CAMERAS[name].arm, tools, self.robot.gripper)
                found[name] = geometry(each.matrix, mount @ pose @ MUJOCO_FROM_OPENCV)
        return found

    def _measure(self) -> None:
        readings, grippers = self.readings(), self.gripper_readings()
        joints = np.array([readings[side].joints for side in SIDES])
        self._velocities = np.array([readings[side].velocities for side in SIDES])
        openings = np.array([grippers[side].opening for side in SIDES])
        self._state = DuoState(
            joints=joints, openings=openings, tcp_poses=self.robot.tcp_poses(joints)
        )
        self.time = self.clock.now()

    def _here(self) -> DuoCommand:
        state = self.read()
        return DuoCommand(joints=state.joints.copy(), openings=state.openings.copy())
