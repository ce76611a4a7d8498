"""The driver of a Franka Hand by franky itself, against franky-sim in a process of its own."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing

import pytest

from duobench.real.clock import SystemClock
from duobench.real.drivers.franka_hand import FrankaHand
from duobench.real.rig import GripperConfig
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.programs import begun, kill

pytest.importorskip("franky", reason="franky-control is not installed; see `make test-hardware`")
pytest.importorskip("franky_sim", reason="franky-sim is not installed")
CONFIG = GripperConfig(driver="franka_hand", port="127.0.0.1", speed=255)


@pytest.fixture
def arms() -> Iterator[subprocess.Popen[str]]:
    server = begun("with_libraries.arms", "ready", json.dumps(HOME_JOINTS.tolist()))
    yield server
    kill(server)


@pytest.mark.usefixtures("arms")
def test_a_stream_of_targets_closes_it_and_a_hold_stops_it() -> None:
    with closing(FrankaHand(CONFIG, SystemClock())) as hand:
        hand.connect()
        hand.activate()
        for number in range(60):
            hand.command(1.0 - number / 59)
            time.sleep(1 / 30)
        time.sleep(1.5)
        assert hand.read().opening < 0.1
        assert not hand.read().has_object, "fingers that meet hold nothing"
        hand.command(0.7)
        time.sleep(2.0)
        assert hand.read().opening == pytest.approx(0.7, abs=0.1)
        hand.command(0.0)
        time.sleep(0.4)
        hand.hold()
        time.sleep(0.5)
        stopped = hand.read().opening
        time.sleep(0.5)
        assert hand.read().opening == pytest.approx(stopped, abs=0.02)
        assert hand.read().fault is None
