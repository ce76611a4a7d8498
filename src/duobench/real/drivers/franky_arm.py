"""One FR3 by franky: a torque loop in C++ tracks the latest point of our path at 1 kHz.

The library neither interpolates nor watches: it keeps the last point for ever, raises nothing after
a reflex, and takes a second to notice that a robot is gone. So a thread for each arm asks all the
time, and its callers send smooth paths. Not yet tried on an arm.
"""

import threading
from collections.abc import Mapping
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from duobench.core.errors import BackendError
from duobench.core.machine import load_extra
from duobench.core.types import Array
from duobench.real.clock import Clock, Ticker
from duobench.real.devices import ArmReading
from duobench.real.drivers.franka_errors import (
    errors_in,
    fault_of_errors,
    fault_of_exception,
)
from duobench.real.rig import ArmConfig
from duobench.results.labels import Fault

READ_HZ = 200.0
"""Queries of an arm's state a second."""
START_S = 2.0
"""Seconds in which an arm has to begin to track."""
TORQUE_CHANGE = 2.0
"""Largest change of a joint's torque that the loop asks for in a millisecond, in N·m. The library's
filter of 100 Hz lets 0.39 of it pass, 770 N·m/s, and an arm takes 1000 [libfranka]. With the
library's own 1.0 stiff joints swung themselves up to twice their speed in a strict simulator."""
ARRAYS = (
    "q",
    "q_d",
    "dq",
    "dq_d",
    "ddq_d",
    "tau_J",
    "tau_J_d",
    "dtau_J",
    "tau_ext_hat_filtered",
    "theta",
    "dtheta",
    "joint_contact",
    "joint_collision",
    "cartesian_contact",
    "cartesian_collision",
    "O_F_ext_hat_K",
    "K_F_ext_hat_K",
    "F_x_Cee",
    "F_x_Cload",
    "F_x_Ctotal",
    "O_ddP_O",
)
"""Vectors of the robot state, by the names of libfranka."""
POSES = ("O_T_EE", "O_T_EE_d", "O_T_EE_c", "F_T_EE", "F_T_NE", "NE_T_EE", "EE_T_K")
"""Poses of the robot state, written as matrices (16,), column by column as libfranka has them."""
NUMBERS = ("m_ee", "m_load", "m_total", "control_command_success_rate")
"""Single numbers of the robot state."""


class FrankyArm:
    """An `Arm` over `franky.Robot` and its `JointImpedanceTracker`."""

    def __init__(self, config: ArmConfig, clock: Clock) -> None:
        self._config, self._clock = config, clock
        self._lock = threading.RLock()  # of the tracker, which several threads use
        self._library: ModuleType | None = None
        self._robot: Any = None
        self._tracker: Any = None
        self._reading: ArmReading | None = None
        self._fault: Fault | None = None
        self._is_gone = False  # and has to be reached again
        self._ticker: Ticker | None = None

    def connect(self) -> None:
        """Reach the arm, and begin to ask it; nothing moves."""
        if self._ticker is not None:
            return
        needed = "Arms need the library franky"
        self._library = load_extra("franky", "hardware", needed, BackendError)
        self._reach()
        self._poll()
        self._ticker = self._clock.every(1.0 / READ_HZ, self._poll, "franky")

    def read(self) -> ArmReading:
        """The latest reading, which never waits for the arm."""
        if self._reading is None:
            raise BackendError("The arm is not connected.")
        return self._reading

    def start(self) -> None:
        """Hold the measured joints and follow `command` from now on."""
        franky, config = self._known(), self._config
        with self._lock:
            self._fault = None
            try:
                if self._robot.has_errors:
                    names = ", ".join(errors_in(self._robot.state.current_errors))
                    raise BackendError(
                        f"The arm at {config.address} has errors: {names}."
                    )
                self._robot.set_collision_behavior(
                    [*config.torque_threshold], [*config.tool_thresholds]
                )
                self._tracker = franky.JointImpedanceTracker(
                    self._robot,
                    stiffness=np.array(config.stiffness),
                    damping=np.array(config.damping),
                    max_delta_tau=TORQUE_CHANGE,
                )
            except self._errors() as error:
                self._tracker = None
                raise BackendError(
                    f"The arm at {config.address} does not begin to track: {error}"
                ) from error
        end = self._clock.now() + START_S
        while not (reading := self.read()).is_tracking:
            if reading.fault is not None or self._clock.now() >= end:
                why = (
                    "it says nothing about why"
                    if reading.fault is None
                    else reading.fault.text
                )
                raise BackendError(
                    f"The arm at {config.address} does not begin to track: {why}"
                )
            self._clock.wait_until(self._clock.now() + 1.0 / READ_HZ)

    def command(self, joints: Array, velocities: Array) -> None:
        """Track a point of a smooth path; a stopped arm says nothing, see `read`."""
        tracker = self._tracker
        if tracker is not None:
            tracker.set_target(joints, velocities)

    def stop(self) -> None:
        """Come to rest by damping, and follow no more commands."""
        with self._lock:
            tracker, self._tracker = self._tracker, None
            if tracker is not None:
                try:
                    tracker.stop()
                except self._errors() as error:  # it had stopped by itself
                    self._note(error)
        if self._reading is not None:
            self._reading = replace(self._reading, is_tracking=False)

    def recover(self) -> None:
        """Clear a reflex, or reach an arm again that was gone; nothing moves."""
        self.stop()
        address = self._config.address
        with self._lock:
            try:
                if self._is_gone:
                    self._robot = None  # an arm takes one connection at a time
                    self._reach()
                    self._is_gone = False
                is_well = (
                    not self._robot.has_errors or self._robot.recover_from_errors()
                )
            except self._errors() as error:
                self._is_gone = True
                raise BackendError(
                    f"The arm at {address} does not recover: {error}"
                ) from error
            if not is_well:
                raise BackendError(
                    f"The arm at {address} does not recover from its errors."
                )
            self._fault = None
        self._poll()
        fault = self.read().fault
        if fault is not None:
            raise BackendError(f"The arm at {address} does not recover: {fault.text}")

    def close(self) -> None:
        """Stop, and let go of the arm."""
        self.stop()
        if self._ticker is not None:
            self._ticker.stop()
            self._ticker = None
        self._robot = None

    # --- asking ----------------------------------------------------------------------------------

    def _poll(self) -> None:
        robot = self._robot
        if robot is None:
            return
        try:
            now, state = self._clock.now(), robot.state
            is_tracking = self._is_running()
        except self._errors() as error:
            self._note(error)
            if self._reading is not None:
                self._reading = replace(
                    self._reading, is_tracking=False, fault=self._fault
                )
            return
        mode = str(state.robot_mode).rpartition(".")[2]
        fault = self._fault or fault_of_errors(errors_in(state.current_errors), mode)
        self._reading = ArmReading(
            time_s=now,
            joints=np.array(state.q, dtype=np.float64),
            velocities=np.array(state.dq, dtype=np.float64),
            torques=np.array(state.tau_J, dtype=np.float64),
            is_tracking=is_tracking and fault is None,
            fault=fault,
            state=state_of(state),
        )

    def _is_running(self) -> bool:
        """Whether the torque loop runs; an error that ended it is noted."""
        tracker = self._tracker
        if tracker is None:
            return False
        is_running = bool(tracker.is_running)
        try:
            self._robot.poll_motion()
        except self._errors() as error:
            self._note(error)
            return False
        return is_running

    def _note(self, error: BaseException) -> None:
        """Keep the first fault until the arm is recovered."""
        if self._fault is None:
            franky = self._known()
            lost = (
                franky.NetworkException,
                franky.ProtocolException,
                franky.RealtimeException,
            )
            self._is_gone = isinstance(error, lost)
            self._fault = fault_of_exception(error, lost)

    # --- the library -----------------------------------------------------------------------------

    def _reach(self) -> None:
        franky, config = self._known(), self._config
        realtime = franky.RealtimeConfig
        try:
            self._robot = franky.Robot(
                config.address,
                # One number for all; `start` gives each joint its own.
                default_torque_threshold=min(config.torque_threshold),
                default_force_threshold=min(config.tool_thresholds),
                realtime_config=realtime.Enforce
                if config.is_realtime
                else realtime.Ignore,
            )
        except self._errors() as error:
            raise BackendError(
                f"The arm at {config.address} cannot be reached: {error} Is it switched on, with "
                "FCI enabled and brakes open, and is this computer in its network?"
            ) from error

    def _known(self) -> ModuleType:
        if self._library is None:
            raise BackendError("The arm is not connected.")
        return self._library

    def _errors(self) -> tuple[type[Exception], ...]:
        return (self._known().Exception, RuntimeError, OSError)


def state_of(state: Any) -> Mapping[str, Array]:
    """A robot state as arrays, by the names of libfranka; what is missing is left out."""
    found: dict[str, Any] = {
        name: getattr(state, name, None) for name in (*ARRAYS, *NUMBERS)
    }
    for name in POSES:
        found[name] = getattr(getattr(state, name, None), "matrix", None)
    found["elbow"] = getattr(getattr(state, "elbow", None), "joint_3_pos", None)
    return {
        name: np.array(value, dtype=np.float64, ndmin=1).ravel(order="F")
        for name, value in found.items()
        if value is not None
    }
