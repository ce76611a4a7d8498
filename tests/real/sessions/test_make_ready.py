"""What an operator at a terminal can do about what keeps the arms from going home."""

from collections.abc import Iterator
from contextlib import closing

import pytest

from duobench.core.types import Side
from duobench.real.clock import VirtualClock
from duobench.real.duo import FrankaDuo
from duobench.real.opening import open_rig, rehearsal_rig
from duobench.real.sessions.operator import ask_to_make_ready
from tests.real.rigs import wait
from tests.real.sessions.test_recording import Script
from tests.real.simulated import simulated_rig


@pytest.fixture(params=[rehearsal_rig()], ids=["rehearsal"])
def duo(request: pytest.FixtureRequest) -> Iterator[FrankaDuo]:
    with closing(open_rig(request.param, VirtualClock(), guard=False)) as made:
        made.start()
        yield made


@pytest.mark.slow
@pytest.mark.parametrize("code", [0x0D, 0x0E], ids=hex)
@pytest.mark.parametrize("is_active", [True, False])
def test_gripper_with_a_fault_that_only_activation_clears(
    duo: FrankaDuo, code: int, is_active: bool
) -> None:
    if is_active:
        duo.hands.activate()
    assert duo.world is not None
    duo.world.grippers[Side.LEFT].fault = code
    wait(duo, 0.3)
    assert duo.fault is not None
    assert Side.LEFT in duo.hands.to_activate
    script = Script("rar")
    assert ask_to_make_ready(duo, script)
    assert "a: Nothing is between the fingers: activate" in script.asked[0]
    assert script.answers == []
    assert duo.fault is None
    assert duo.hands.to_activate == ()


@pytest.mark.parametrize("duo", [simulated_rig()], ids=["simulated"], indirect=True)
def test_fault_of_an_arm_offers_no_activation(duo: FrankaDuo) -> None:
    duo.hands.activate()
    duo.hold("The light went out.")
    duo.arms[Side.LEFT].fail("joint_reflex")  # type: ignore[attr-defined]
    wait(duo, 0.3)
    script = Script("r")
    assert ask_to_make_ready(duo, script)
    assert "a: " not in script.asked[0]
