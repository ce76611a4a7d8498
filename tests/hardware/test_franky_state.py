"""What an arm stopped for, told apart: what counts against who led it, and what does not."""

from __future__ import annotations

import pytest

from duobench.hardware.devices import FaultKind
from duobench.hardware.drivers.franky_state import fault_of_errors, fault_of_exception

LOST = "communication_constraints_violation"
FAST = "joint_velocity_violation"
ABORTED = "libfranka: Move command aborted: motion aborted by reflex! [{}]\nsuccess rate: 0.71"
"""As the library says it."""


class NetworkError(Exception):
    """Stands for the library's errors of networks."""


@pytest.mark.parametrize(
    ("names", "kind"),
    [
        ([LOST], FaultKind.COMMUNICATION),
        ([FAST], FaultKind.REFLEX),
        ([LOST, FAST], FaultKind.REFLEX),
    ],
)
def test_lost_packets_alone_are_no_failure_of_who_led_the_arm(
    names: list[str], kind: FaultKind
) -> None:
    text = ABORTED.format(", ".join(f'"{name}"' for name in names))
    fault = fault_of_exception(RuntimeError(text), (NetworkError,))
    assert (fault.kind, fault.text) == (kind, text)
    told = fault_of_errors(names)
    assert told is not None
    assert told.kind is kind


def test_errors_of_the_network_are_communication_and_others_reflexes() -> None:
    lost = (NetworkError,)
    assert fault_of_exception(NetworkError("gone"), lost).kind is FaultKind.COMMUNICATION
    assert fault_of_exception(RuntimeError("contact"), lost).kind is FaultKind.REFLEX
    assert fault_of_errors([]) is None
