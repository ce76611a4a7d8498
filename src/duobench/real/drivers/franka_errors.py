"""Errors that stop an FR3, in the names of libfranka, with their kinds of fault."""

import re
from collections.abc import Iterable
from typing import Any

from duobench.results.labels import Fault, FaultKind

_CONTACT = ("joint_reflex", "cartesian_reflex")
_LIMIT = (
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "power_limit_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "joint_move_in_wrong_direction",
    "force_control_safety_violation",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_via_motion_generator_planning_joint_limit_violation",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
)
_CONTROLLER = (
    "controller_torque_discontinuity",
    "tau_j_range_violation",
    "instability_detected",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "joint_p2p_insufficient_torque_for_planning",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_position_motion_generator_invalid_frame",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_spline_motion_generator_violation",
    "force_controller_desired_force_tolerance_violation",
    "start_elbow_sign_inconsistent",
)
_COMMUNICATION = (
    "communication_constraints_violation",
    "base_acceleration_initialization_timeout",
    "base_acceleration_invalid_reading",
)
KINDS = {
    **dict.fromkeys(_CONTROLLER, FaultKind.CONTROLLER),
    **dict.fromkeys(_CONTACT, FaultKind.CONTACT),
    **dict.fromkeys(_LIMIT, FaultKind.LIMIT),
    **dict.fromkeys(_COMMUNICATION, FaultKind.COMMUNICATION),
}
"""The kind of each of the 41 errors of an arm's state [libfranka, `franka::Errors`]. Where several
stand together, the first kind in this order counts: what might be our controller's doing is never
blamed on who led the arm, and a lost packet does not excuse a collision."""
_ORDER = tuple(dict.fromkeys(KINDS.values()))
MODES_OF_PEOPLE = ("UserStopped", "Guiding")
"""Modes into which people bring an arm with buttons."""
_PEOPLE = re.compile(r"user.?stop|safety function|guiding", re.IGNORECASE)
"""Words of libfranka where a button, a door or a safety input ended a motion."""


def errors_in(errors: Any) -> tuple[str, ...]:
    """Names of the errors that a set of them (`current_errors`) has raised."""
    names = (name for name in dir(errors) if not name.startswith("_"))
    return tuple(name for name in names if getattr(errors, name) is True)


def fault_of_errors(names: Iterable[str], mode: str = "") -> Fault | None:
    """Fault for the errors and the mode of an arm; None without a fault.

    An error that is not in the table is a limit, about which the operator is asked.
    """
    names = tuple(names)
    if names:
        return _kind_of(names).fault(", ".join(names))
    if mode == "Reflex":
        return FaultKind.CONTACT.fault("The arm is in its reflex mode.")
    if mode in MODES_OF_PEOPLE:
        return FaultKind.PERSON.fault(f"The arm is in the mode {mode}.")
    return None


def fault_of_exception(
    error: BaseException, lost: tuple[type[BaseException], ...]
) -> Fault:
    """The fault that an error of the library is; `lost` are those of networks and packets.

    What stopped an arm stands in the text as a list of names in quotation marks, or in words.
    """
    text = str(error).strip() or type(error).__name__
    if isinstance(error, lost):
        return FaultKind.COMMUNICATION.fault(text)
    names = re.findall(r'"(\w+)"', text)
    if names:
        return _kind_of(names).fault(text)
    if _PEOPLE.search(text):
        return FaultKind.PERSON.fault(text)
    return (FaultKind.CONTACT if "reflex" in text else FaultKind.LIMIT).fault(text)


def _kind_of(names: Iterable[str]) -> FaultKind:
    kinds = {KINDS.get(name.lower(), FaultKind.LIMIT) for name in names}
    return min(kinds, key=_ORDER.index)
