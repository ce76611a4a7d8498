"""Safety rule 7 at the driver of an arm: what the rig's file says is what the library is told."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import BackendError
from duobench.real.clock import VirtualClock
from duobench.real.drivers import franky_arm
from duobench.real.drivers.franka_errors import (
    KINDS,
    MODES_OF_PEOPLE,
    fault_of_errors,
    fault_of_exception,
)
from duobench.real.rig import ArmConfig
from duobench.results.labels import FaultKind

CONFIG = ArmConfig(
    address="172.16.0.2",
    stiffness=(11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0),
    damping=(6.0, 6.1, 6.2, 6.3, 6.4, 6.5, 6.6),
    torque_threshold=(21.0, 20.0, 19.0, 18.0, 9.0, 8.0, 7.0),
    force_threshold=25.0,
    moment_threshold=6.0,
)


class FakeRobot:
    """Remembers what it was told; it stands at zero."""

    has_errors = False

    def __init__(self, address: str, **options: Any) -> None:
        self.address, self.options = address, options
        self.behavior: tuple[list[float], list[float]] | None = None

    @property
    def state(self) -> SimpleNamespace:
        zeros = [0.0] * 7
        return SimpleNamespace(
            q=zeros, dq=zeros, tau_J=zeros, robot_mode="RobotMode.Move", current_errors=None
        )

    def set_collision_behavior(self, torques: list[float], forces: list[float]) -> None:
        self.behavior = torques, forces

    def poll_motion(self) -> None: ...


class FakeTracker:
    def __init__(self, robot: FakeRobot, **gains: Any) -> None:
        assert robot.behavior is not None, "thresholds come before anything can move"
        self.gains, self.is_running = gains, True

    def stop(self) -> None:
        self.is_running = False


@pytest.fixture
def arm(monkeypatch: pytest.MonkeyPatch) -> Iterator[franky_arm.FrankyArm]:
    franky = SimpleNamespace(
        Robot=FakeRobot,
        JointImpedanceTracker=FakeTracker,
        RealtimeConfig=SimpleNamespace(Enforce="enforce", Ignore="ignore"),
        Exception=type("Exception", (Exception,), {}),
    )
    monkeypatch.setitem(sys.modules, "franky", franky)
    made = franky_arm.FrankyArm(CONFIG, VirtualClock())
    made.connect()
    yield made
    made.close()


def test_thresholds_and_gains_are_those_of_the_rigs_file(arm: franky_arm.FrankyArm) -> None:
    robot: FakeRobot = arm._robot
    assert robot.address == CONFIG.address
    assert robot.options == {
        "default_torque_threshold": 7.0,
        "default_force_threshold": 6.0,
        "realtime_config": "enforce",
    }
    arm.start()
    assert robot.behavior == (list(CONFIG.torque_threshold), [25.0] * 3 + [6.0] * 3)
    gains = {name: np.ravel(value).tolist() for name, value in arm._tracker.gains.items()}
    assert gains == {
        "stiffness": list(CONFIG.stiffness),
        "damping": list(CONFIG.damping),
        "max_delta_tau": [franky_arm.TORQUE_CHANGE],
    }


def test_an_arm_with_errors_does_not_begin_to_track(
    arm: franky_arm.FrankyArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FakeRobot, "has_errors", True)
    with pytest.raises(BackendError, match="has errors"):
        arm.start()
    assert arm._tracker is None


# --- what an arm stopped for -----------------------------------------------------------------

LOST, FAST, MET = "communication_constraints_violation", "joint_velocity_violation", "joint_reflex"
UNSTABLE = "controller_torque_discontinuity"
ABORTED = "libfranka: Move command aborted: motion aborted by reflex! [{}]\nsuccess rate: 0.71"
"""As the library says it."""


class NetworkError(Exception):
    """Stands for the library's errors of networks."""


def kind_of(text: str) -> FaultKind:
    return fault_of_exception(RuntimeError(text), (NetworkError,)).kind


@pytest.mark.parametrize(
    ("names", "kind"),
    [
        ([LOST], FaultKind.COMMUNICATION),
        ([FAST], FaultKind.LIMIT),
        ([LOST, MET], FaultKind.CONTACT),
        ([FAST, MET], FaultKind.CONTACT),
        ([UNSTABLE, MET], FaultKind.CONTROLLER),
        (["tau_J_range_violation"], FaultKind.CONTROLLER),  # as the text has it, not the state
        (["an_error_of_tomorrow"], FaultKind.LIMIT),
    ],
)
def test_several_errors_have_the_kind_that_blames_least_but_for_lost_packets(
    names: list[str], kind: FaultKind
) -> None:
    text = ABORTED.format(", ".join(f'"{name}"' for name in names))
    assert kind_of(text) is kind
    told = fault_of_errors(names)
    assert told is not None
    assert told.kind is kind


def test_every_error_of_the_state_has_a_kind() -> None:
    assert len(KINDS) == 41
    assert {kind for name, kind in KINDS.items() if "reflex" in name} == {FaultKind.CONTACT}
    assert set(KINDS.values()) == set(FaultKind) - {FaultKind.PERSON}


@pytest.mark.parametrize(
    "text",
    [
        "libfranka: Move command aborted: command aborted: User Stop pressed!",
        'libfranka: command not possible in the current mode ("User stopped")!',
        "libfranka: Move command preempted: preempted due to activated safety function!",
    ],
)
def test_what_a_person_or_a_door_stopped_is_no_reflex(text: str) -> None:
    assert kind_of(text) is FaultKind.PERSON
    for mode in MODES_OF_PEOPLE:
        told = fault_of_errors([], mode)
        assert told is not None
        assert told.kind is FaultKind.PERSON


def test_errors_of_the_network_are_communication_and_unknown_ones_are_asked_about() -> None:
    error = fault_of_exception(NetworkError("gone"), (NetworkError,))
    assert error.kind is FaultKind.COMMUNICATION
    assert kind_of("motion aborted by reflex!") is FaultKind.CONTACT
    assert kind_of("something else") is FaultKind.LIMIT
    assert fault_of_errors([]) is None
