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

from duobench.data import DataSet
from duobench.types import SIDES
from tests.hardware.with_libraries import strict_arms
from tests.hardware.with_libraries.strict_arms import StrictArms

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


def begun(name: str, folder: Path) -> subprocess.Popen[str]:
    """A program whose arms are fast."""
    program = "tests.hardware.with_libraries.strict_faults"
    command = [sys.executable, "-m", program, name, str(folder)]
    player = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert player.stdout is not None
    assert player.stdout.readline() == "moving\n"
    return player


def end_of(player: subprocess.Popen[str], folder: Path) -> dict[str, Any]:
    """What it saw; whatever happened, nothing recorded is lost and the arms can go home again."""
    assert player.stdout is not None
    with player:
        seen: dict[str, Any] = json.loads(player.stdout.readline())
        assert player.wait(60) == 0
    (recording,) = DataSet.open(folder).recordings()
    assert recording.info.outcome is not None
    assert recording.info.outcome.reason == seen["reason"]
    assert len(recording.sent) in {seen["steps"], seen["steps"] + 1}
    assert min(seen["speed_before"]) > MOVING
    assert seen["rest_s"] < STILL_S
    assert seen["state"] == "ready"
    sys.stdout.write(json.dumps(seen) + "\n")  # with pytest -rP
    return seen


@pytest.mark.usefixtures("arms")
@pytest.mark.parametrize(
    ("name", "kind", "text"),
    [
        ("gripper", "communication", "The right gripper: The gripper has not answered for"),
        ("camera", "communication", "The latest image of the camera head is"),
        ("person", None, "The button on the page."),
    ],
)
def test_both_arms_hold_and_neither_has_a_reflex(
    name: str, kind: str | None, text: str, tmp_path: Path
) -> None:
    seen = end_of(begun(name, tmp_path / "data"), tmp_path / "data")
    assert text in seen["reason"]
    assert seen["fault_kind"] == kind
    assert seen["is_tracking"] == [True, True]
    assert seen["errors"] == ["", ""]


@pytest.mark.usefixtures("arms")
def test_a_policy_that_stalls_leaves_both_arms_at_rest_and_then_stopped(tmp_path: Path) -> None:
    seen = end_of(begun("stall", tmp_path / "data"), tmp_path / "data")
    assert seen["reason"].startswith("No command came for")
    assert seen["fault_kind"] is None
    assert seen["is_tracking"] == [False, False]
    assert seen["errors"] == ["", ""]


@pytest.mark.usefixtures("arms")
def test_a_jump_trips_a_reflex_and_the_other_arm_holds(tmp_path: Path) -> None:
    seen = end_of(begun("jump", tmp_path / "data"), tmp_path / "data")
    assert seen["fault_kind"] == "reflex"
    assert "The left arm" in seen["reason"]
    assert seen["is_tracking"] == [False, True]
    assert seen["errors"][1] == ""


def test_a_process_that_is_frozen_stops_both_arms_and_says_so(
    arms: StrictArms, tmp_path: Path
) -> None:
    player = begun("nothing", tmp_path / "data")
    player.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    said = [arms.said(side) for side in SIDES]
    player.send_signal(signal.SIGCONT)
    seen = end_of(player, tmp_path / "data")
    assert all("communication_constraints_violation" in text for text in said)
    assert seen["fault_kind"] == "communication"
    assert seen["is_tracking"] == [False, False]


@pytest.mark.usefixtures("arms")
def test_a_killed_process_loses_next_to_nothing_and_the_arms_can_be_led_again(
    tmp_path: Path,
) -> None:
    player = begun("nothing", tmp_path / "data")
    player.kill()
    with player:
        player.wait(10)
    data = DataSet.open(tmp_path / "data")
    (partial,) = data.partials()
    data.recover(partial)
    (recording,) = data.recordings()
    assert len(recording.sent) >= 15
    end_of(begun("person", tmp_path / "again"), tmp_path / "again")
