"""Both arms by franky against two franka-sim, which enforce an arm's limits and trip reflexes.

They have an environment of their own; `make test-hardware` names its Python. DUOBENCH_TARGETS is
the number of random targets, thirty a second: 10000 takes six minutes for each pair of limits.
DUOBENCH_RESETS is that of resets in full motion: 500 takes twenty.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from duobench.real.rig import MAX_ACCELERATION, MAX_SPEED_FRACTION, ArmConfig
from tests.real.with_libraries import strict_arms

pytest.importorskip("franky", reason="franky-control is not installed; see `make test-hardware`")
RESETS = int(os.environ.get("DUOBENCH_RESETS", "40"))
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


def play(folder: Path, *words: object, program: str = "strict_targets") -> dict[str, Any]:
    """Run a program against strict arms; what it saw."""
    with strict_arms.strict_arms(folder) as arms:
        module = f"tests.real.with_libraries.{program}"
        command = [sys.executable, "-m", module, *map(str, words)]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    rates = {str(side): min(rates[1:-1]) for side, rates in arms.rates().items()}
    seen: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    sys.stdout.write(json.dumps({**seen, "slowest_second_hz": rates}) + "\n")  # with pytest -rP
    return seen


@pytest.mark.parametrize("limits", LIMITS)
def test_no_target_that_is_accepted_trips_a_reflex(limits: str, tmp_path: Path) -> None:
    speed, acceleration = LIMITS[limits]
    seen = play(tmp_path, TARGETS, speed, acceleration)
    assert seen["targets"] == TARGETS
    assert [text for kind, text in seen["faults"] if kind != "communication"] == []
    assert min(seen["fastest"]) > FAST * speed


def test_what_the_guard_accepts_trips_no_reflex_either(tmp_path: Path) -> None:
    seen = play(tmp_path, TARGETS, NEW.speed_fraction, NEW.acceleration, "guard")
    reflexes = [text for kind, text in seen["faults"] if kind != "communication"]
    assert [text for text in reflexes if not text.startswith("The guard refused")] == []
    assert min(seen["fastest"]) > 0.1


def test_resets_in_full_motion_trip_no_reflex_and_keep_the_acceleration(tmp_path: Path) -> None:
    seen = play(tmp_path, RESETS, program="strict_resets")
    assert seen["resets"] == RESETS
    assert seen["in_motion"] > 0.8 * RESETS
    assert [text for kind, text in seen["faults"] if kind != "communication"] == []
    assert seen["acceleration"] <= MAX_ACCELERATION * (1 + 1e-6)
    assert seen["fastest"] > FAST * MAX_SPEED_FRACTION
