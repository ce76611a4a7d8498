"""What goes wrong while both arms move, against two franka-sim: both hold, and the record says why.

franka-sim enforces the limits of arms and of their network; see test_strict.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from duobench.core.types import SIDES
from tests.real import programs
from tests.real.with_libraries import strict_arms
from tests.real.with_libraries.strict_arms import StrictArms

pytest.importorskip("franky", reason="franky-control is not installed; see `make test-hardware`")
pytestmark = pytest.mark.skipif(
    not strict_arms.IS_INSTALLED, reason="franka-sim is not installed; see `make test-hardware`"
)
MOVING = 0.3
"""Speed of the fastest joint of each arm in rad/s, at least, when something goes wrong."""
STILL_S = 1.0
"""Seconds after the episode's end in which both arms stand still."""


@pytest.fixture
def arms(tmp_path: Path) -> Iterator[StrictArms]:
    with strict_arms.strict_arms(tmp_path) as arms:
        yield arms


def moving(name: str, folder: Path) -> subprocess.Popen[str]:
    """A program whose arms are fast."""
    return programs.begun("with_libraries.strict_faults", "moving", name, folder / name)


def end_of(name: str, folder: Path, player: subprocess.Popen[str] | None = None) -> dict[str, Any]:
    """What it saw; whatever happened, the arms can go home again."""
    seen, _ = programs.end_of(player or moving(name, folder), folder / name)
    assert min(seen["speed_before"]) > MOVING
    assert seen["rest_s"] < STILL_S
    assert seen["state"] == "ready"
    sys.stdout.write(json.dumps(seen) + "\n")  # with pytest -rP
    return seen


@pytest.mark.usefixtures("arms")
@pytest.mark.parametrize(
    ("name", "kind", "text", "is_tracking"),
    [
        ("gripper", "communication", "The right gripper: The gripper has not answered for", True),
        ("camera", "communication", "The latest image of the camera head is", True),
        ("person", None, "The button on the page.", True),
        ("stall", None, "No command came for", False),
    ],
)
def test_both_arms_hold_or_stop_and_neither_has_a_reflex(
    name: str, kind: str | None, text: str, is_tracking: bool, tmp_path: Path
) -> None:
    seen = end_of(name, tmp_path)
    assert text in seen["reason"]
    assert seen["fault_kind"] == kind
    assert seen["is_tracking"] == [is_tracking, is_tracking]
    assert seen["errors"] == ["", ""]


@pytest.mark.usefixtures("arms")
def test_a_jump_trips_a_reflex_and_the_other_arm_holds(tmp_path: Path) -> None:
    seen = end_of("jump", tmp_path)
    assert seen["fault_kind"] in {"contact", "limit", "controller"}
    assert "The left arm" in seen["reason"]
    assert seen["is_tracking"] == [False, True]
    assert seen["errors"][1] == ""


def test_a_process_that_is_frozen_stops_both_arms_and_says_so(
    arms: StrictArms, tmp_path: Path
) -> None:
    player = moving("nothing", tmp_path)
    player.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    said = [arms.said(side) for side in SIDES]
    player.send_signal(signal.SIGCONT)
    seen = end_of("nothing", tmp_path, player)
    assert all("communication_constraints_violation" in text for text in said)
    assert seen["fault_kind"] == "communication"
    assert seen["is_tracking"] == [False, False]


@pytest.mark.usefixtures("arms")
def test_a_killed_process_loses_next_to_nothing_and_the_arms_can_be_led_again(
    tmp_path: Path,
) -> None:
    programs.kill(moving("nothing", tmp_path))
    assert len(programs.recovered(tmp_path / "nothing").sent) >= 15
    end_of("person", tmp_path)
