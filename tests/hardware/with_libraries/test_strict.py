"""Both arms by franky against two franka-sim, which enforce an arm's limits and trip reflexes.

They have an environment of their own; `make test-hardware` names its Python. DUOBENCH_TARGETS is
the number of random targets, thirty a second: 10000 takes six minutes for each pair of limits.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from duobench.hardware.rig import MAX_ACCELERATION, MAX_SPEED_FRACTION, ArmConfig
from tests.hardware.with_libraries import strict_arms

pytest.importorskip("franky", reason="franky-control is not installed; see `make test-hardware`")
TARGETS = int(os.environ.get("DUOBENCH_TARGETS", "600"))
pytestmark = pytest.mark.skipif(
    not strict_arms.IS_INSTALLED, reason="franka-sim is not installed; see `make test-hardware`"
)
NEW = ArmConfig(address="")
LIMITS = {
    "of a new rig": (NEW.speed_fraction, NEW.acceleration),
    "at most": (MAX_SPEED_FRACTION, MAX_ACCELERATION),
}
FAST = 0.9
"""Part of its speed limits that an arm has to reach, or nothing was tried."""


def play(folder: Path, speed: float, acceleration: float, *words: str) -> dict[str, Any]:
    program = "tests.hardware.with_libraries.strict_targets"
    numbers = [str(TARGETS), str(speed), str(acceleration)]
    with strict_arms.strict_arms(folder) as arms:
        command = [sys.executable, "-m", program, *numbers, *words]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    rates = {str(side): min(rates[1:-1]) for side, rates in arms.rates().items()}
    seen: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    sys.stdout.write(json.dumps({**seen, "slowest_second_hz": rates}) + "\n")  # with pytest -rP
    return seen


@pytest.mark.parametrize("limits", LIMITS)
def test_no_target_that_is_accepted_trips_a_reflex(limits: str, tmp_path: Path) -> None:
    speed, acceleration = LIMITS[limits]
    seen = play(tmp_path, speed, acceleration)
    assert seen["targets"] == TARGETS
    assert [text for kind, text in seen["faults"] if kind != "communication"] == []
    assert min(seen["fastest"]) > FAST * speed


def test_what_the_guard_accepts_trips_no_reflex_either(tmp_path: Path) -> None:
    seen = play(tmp_path, NEW.speed_fraction, NEW.acceleration, "guard")
    reflexes = [text for kind, text in seen["faults"] if kind != "communication"]
    assert [text for text in reflexes if not text.startswith("The guard refused")] == []
    assert min(seen["fastest"]) > 0.1
