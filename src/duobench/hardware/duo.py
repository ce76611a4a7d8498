"""Two real arms with grippers and cameras as a `DuoBackend`: commands in, motion out."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from duobench.backend import DuoLimits
from duobench.errors import ActionError, BackendError, escaped
from duobench.hardware.clock import Clock
from duobench.hardware.devices import Arm, Camera, Fault, FaultKind, Gripper
from duobench.hardware.guard import Guard
from duobench.hardware.motion.follower import PERIOD
from duobench.hardware.rig import Rig
from duobench.hardware.supervisor import HELD, State
from duobench.hardware.watched import WatchedRig
from duobench.robot.joints import HOME_JOINTS, RANGE_MARGIN, duo_limits, speed_limits
from duobench.types import SIDES, Array, DuoCommand, Side

HOME_SHARE = 0.8
"""Part of the speed on the way home that the way itself takes; the rest is for catching up."""
SLOWEST = 0.02
"""Speed in rad/s with which a joint leaves an end of its range."""
HOME_TOLERANCE = 0.03
"""How near in radians a joint has to be home, which an arm with a soft grip on its joints may miss
by a little."""
SETTLE_S = 5.0
"""Seconds that arms may take to come to rest, and grippers to open."""
OPEN = 0.9
"""Opening from which a gripper counts as open."""


class HardwareDuo(WatchedRig):
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
        super().__init__(rig, clock, arms=arms, grippers=grippers, cameras=cameras, guard=guard)
        self._configs = configs = [rig.arms[side] for side in SIDES]
        left, right = (config.speed_fraction for config in configs)
        self._nominal = duo_limits()
        self._limits = duo_limits((left, right), RANGE_MARGIN)
        self._accelerations = np.array([[config.acceleration] for config in configs])
        self._due = 0.0
        self._late = 0.0
        self._last: DuoCommand | None = None

    def start(self) -> None:
        """Connect everything; nothing moves. Twice is harmless.

        Raises:
            BackendError: A device cannot be reached; then none is connected.
        """
        was_off = self.supervisor.state is State.OFF
        super().start()
        if was_off:
            self._last = self._here()

    # --- moving ----------------------------------------------------------------------------------

    def home(self) -> None:
        """Go home slowly on a way that the guard found free, and open the grippers.

        Raises:
            BackendError: The operator has not confirmed, no free way was found, or something went
                wrong on the way; then both arms are held.
        """
        self.start()
        self.supervisor.check_confirmed()
        way = self.way_home()
        here = self.read().joints
        self.supervisor.begin(State.HOMING)
        self._engage()
        self._drive.limit(is_home=True)
        self._due = self.clock.now()
        for start, end in zip([here, *way[:-1]], way, strict=True):
            self._go(start, end)
        for gripper in self.grippers.values():
            gripper.command(1.0)
        self._last = DuoCommand(joints=HOME_JOINTS.copy(), openings=np.ones(2))
        self._settle()
        self._drive.limit(is_home=False)
        if not self.supervisor.enter(State.READY, only_from=(State.HOMING,)):
            raise BackendError(f"The arms did not get home: {self.held}")

    def way_home(self) -> list[Array]:
        """The way that `home` takes from where the arms are.

        Returns:
            Joint positions (2, 7) to go through, home last, each on a straight line from the one
            before.

        Raises:
            BackendError: The guard found no free one.
        """
        self._measure()
        return (
            [HOME_JOINTS] if self.guard is None else self.guard.way(self.read().joints, HOME_JOINTS)
        )

    def _go(self, start: Array, end: Array) -> None:
        """Lead both arms along a straight line in joint space, as slowly as the rig says."""
        fractions = np.array(
            [[min(arm.home_fraction, arm.speed_fraction)] for arm in self._configs]
        )
        way, share = end - start, 0.0
        while share < 1.0:
            # As fast as the slowest joint may be where it is, so that none leaves the line.
            low, high = map(np.array, zip(*map(speed_limits, start + share * way), strict=True))
            speeds = np.maximum(HOME_SHARE * fractions * np.minimum(-low, high), SLOWEST)
            share = min(1.0, share + PERIOD / max(np.max(np.abs(way) / speeds), PERIOD))
            self._aim(start + share * way)
            self._tick()

    def _aim(self, joints: Array) -> None:
        with self._motion:
            if self.supervisor.state is not State.HOMING:
                raise BackendError(f"The arms did not get home: {self.held or 'they were stopped'}")
            self._drive.aim(joints)

    def _settle(self) -> None:
        """Wait until both arms are at rest at home with open grippers."""
        end = self.clock.now() + SETTLE_S
        while True:
            self._tick()
            if (reason := self.held) is not None:
                raise BackendError(f"The arms did not get home: {reason}")
            here = self._here()
            off = float(np.max(np.abs(here.joints - HOME_JOINTS)))
            if off <= HOME_TOLERANCE and here.openings.min() >= OPEN and self._drive.is_at_rest:
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
        self._late = max(0.0, self.clock.now() - self._due - PERIOD)
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
        if not self._drive.is_engaged:
            self._measure()
            self._engage()
        self._last_heard = self._due = self.clock.now()
        self._drive.limit(is_home=False)
        self.supervisor.begin(State.RUNNING)

    def _send(self, targets: Array) -> None:
        last = self.last_command
        sent = DuoCommand.from_flat(self._limits.clip(targets, last.flat))
        if (objection := self._objection(last.joints, sent.joints)) is not None:
            self._hold(objection.text, objection)
            return
        with self._motion:
            if self.supervisor.state is not State.RUNNING:
                return
            self._drive.send(sent)
            self._last, self._last_heard = sent, self.clock.now()

    def _objection(self, last: Array, target: Array) -> Fault | None:
        """Why the guard does not let a command pass; None if it does."""
        if self.guard is None:
            return None
        try:
            problem = self.guard.problem(target) or self.guard.problem(self._stopping(last, target))
        except Exception as error:  # noqa: BLE001 - whatever it is, nobody looks out then
            text = f"The guard failed: {escaped(repr(error))}"
            return Fault(kind=FaultKind.DEVICE, text=text)
        if problem is None:
            return None
        return Fault(kind=FaultKind.REFLEX, text=f"The guard refused a command: {problem}")

    def _stopping(self, last: Array, target: Array) -> Array:
        """Where the arms come to rest that brake at a target."""
        speeds = (target - last) / PERIOD
        return target + speeds * np.abs(speeds) / (2.0 * self._accelerations)

    def _engage(self) -> None:
        """Have the arms track their followers, from where they are."""
        if self._drive.is_engaged:
            return
        try:
            self._drive.engage()
        except BackendError as error:
            self._hold(str(error), Fault(kind=FaultKind.DEVICE, text=str(error)))
            raise
        self._last_heard = self._due = self.clock.now()
        self._last = self._here()

    def _tick(self) -> None:
        """Wait for the next tick of the control rate, and measure."""
        now = self.clock.now()
        # A step that takes too long leaves out ticks; the grid stays.
        self._due += PERIOD * max(1, math.ceil((now - self._due) / PERIOD))
        self.clock.wait_until(self._due)
        self._measure()

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

    def _here(self) -> DuoCommand:
        """Where the arms are, as a command."""
        state = self.read()
        return DuoCommand(joints=state.joints.copy(), openings=state.openings.copy())
