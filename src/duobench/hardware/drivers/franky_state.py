"""What franky says about an arm, in our words; nothing here needs the library."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from duobench.hardware.devices import ArmReading, Fault, FaultKind
from duobench.types import Array

COMMUNICATION = "communication_constraints_violation"
"""The error of an arm that has missed too many packets in a row."""
ARRAYS = (
    *("q", "q_d", "dq", "dq_d", "ddq_d", "tau_J", "tau_J_d", "dtau_J", "tau_ext_hat_filtered"),
    *("theta", "dtheta", "joint_contact", "joint_collision", "cartesian_contact"),
    *("cartesian_collision", "O_F_ext_hat_K", "K_F_ext_hat_K", "F_x_Cee", "F_x_Cload"),
    *("F_x_Ctotal", "O_ddP_O"),
)
"""Vectors of the robot state, by the names of libfranka."""
POSES = ("O_T_EE", "O_T_EE_d", "O_T_EE_c", "F_T_EE", "F_T_NE", "NE_T_EE", "EE_T_K")
"""Poses of the robot state, written as matrices (16,), column by column as libfranka has them."""
NUMBERS = ("m_ee", "m_load", "m_total", "control_command_success_rate")
"""Single numbers of the robot state."""
MODES_OF_PEOPLE = ("UserStopped", "Guiding")
"""Modes into which people bring an arm with buttons."""


def errors_in(errors: Any) -> tuple[str, ...]:
    """Names of the errors that a set of them (`current_errors`) has raised."""
    names = (name for name in dir(errors) if not name.startswith("_"))
    return tuple(name for name in names if getattr(errors, name) is True)


def fault_of_errors(names: Iterable[str], mode: str = "") -> Fault | None:
    """The fault that errors and the mode of an arm are; None where there is none.

    A packet that was lost is nobody's fault who leads the arm; a reflex is.

    Args:
        names: Names of errors.
        mode: Name of the robot's mode, such as "Reflex".
    """
    names = tuple(names)
    if names:
        is_lost = all(name == COMMUNICATION for name in names)
        kind = FaultKind.COMMUNICATION if is_lost else FaultKind.REFLEX
        return Fault(kind=kind, text=", ".join(names))
    if mode == "Reflex":
        return Fault(kind=FaultKind.REFLEX, text="The arm is in its reflex mode.")
    if mode in MODES_OF_PEOPLE:
        return Fault(kind=FaultKind.DEVICE, text=f"The arm is in the mode {mode}.")
    return None


def fault_of_exception(error: BaseException, lost: tuple[type[BaseException], ...]) -> Fault:
    """The fault that an error of the library is.

    What stopped an arm stands in the text as a list of names in quotation marks.

    Args:
        error: The error.
        lost: The library's errors of networks and packets.
    """
    text = str(error).strip() or type(error).__name__
    names = set(re.findall(r'"(\w+)"', text))
    is_lost = isinstance(error, lost) or names == {COMMUNICATION}
    return Fault(kind=FaultKind.COMMUNICATION if is_lost else FaultKind.REFLEX, text=text)


def state_of(state: Any) -> Mapping[str, Array]:
    """A robot state as arrays, by the names of libfranka; what is missing is left out."""
    found: dict[str, Array] = {}
    for name in ARRAYS:
        value = getattr(state, name, None)
        if value is not None:
            found[name] = np.array(value, dtype=np.float64).ravel()
    for name in POSES:
        matrix = getattr(getattr(state, name, None), "matrix", None)
        if matrix is not None:
            found[name] = np.asarray(matrix, dtype=np.float64).ravel(order="F")
    for name in NUMBERS:
        value = getattr(state, name, None)
        if value is not None:
            found[name] = np.array([float(value)])
    elbow = getattr(getattr(state, "elbow", None), "joint_3_pos", None)
    if elbow is not None:
        found["elbow"] = np.array([float(elbow)])
    return found


def reading_of(state: Any, time_s: float, *, is_tracking: bool, fault: Fault | None) -> ArmReading:
    """A reading.

    Args:
        state: The robot state.
        time_s: When it was read, on the rig's clock.
        is_tracking: Whether the arm follows commands.
        fault: What is wrong with it.
    """
    return ArmReading(
        time_s=time_s,
        joints=np.array(state.q, dtype=np.float64),
        velocities=np.array(state.dq, dtype=np.float64),
        torques=np.array(state.tau_J, dtype=np.float64),
        is_tracking=is_tracking,
        fault=fault,
        state=state_of(state),
    )
