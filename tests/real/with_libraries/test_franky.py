"""Both arms by franky itself, against franky-sim in a process of its own."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.programs import begun, end_of, kill, recovered
from tests.real.rigs import half_tempo

pytest.importorskip("franky", reason="franky-control is not installed; see `make test-hardware`")
pytest.importorskip("franky_sim", reason="franky-sim is not installed")
MEDIAN = 0.015
"""Largest median error of a joint in radians."""


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An expert's episode of bin_sort, each of its steps in two."""
    path = tmp_path_factory.mktemp("targets") / "targets.npy"
    np.save(path, np.array(half_tempo("bin_sort")[0]))
    return path


@pytest.fixture
def arms() -> Iterator[subprocess.Popen[str]]:
    server = begun("with_libraries.arms", "ready", json.dumps(HOME_JOINTS.tolist()))
    yield server
    server.send_signal(signal.SIGCONT)
    kill(server)


def play(targets: Path, folder: Path) -> subprocess.Popen[str]:
    return begun("with_libraries.play", "home", targets, folder)


@pytest.mark.usefixtures("arms")
def test_both_arms_track_an_experts_episode_at_half_tempo(targets: Path, tmp_path: Path) -> None:
    seen, _ = end_of(play(targets, tmp_path), tmp_path)
    assert seen["reason"] is None
    assert seen["steps"] > 200
    assert seen["median"] <= MEDIAN, seen
    assert {"q", "dq", "tau_J", "O_T_EE", "control_command_success_rate"} <= set(seen["arm_states"])


@pytest.mark.parametrize("is_frozen", ["the robots", "this process"])
def test_what_is_frozen_is_noticed_and_nothing_recorded_is_lost(
    arms: subprocess.Popen[str], is_frozen: str, targets: Path, tmp_path: Path
) -> None:
    player = play(targets, tmp_path)
    time.sleep(1.0)
    frozen = arms if is_frozen == "the robots" else player
    frozen.send_signal(signal.SIGSTOP)
    if frozen is player:
        time.sleep(1.0)
        player.send_signal(signal.SIGCONT)
    seen, _ = end_of(player, tmp_path)
    assert seen["fault_kind"] == "communication"
    if frozen is arms:
        assert "arm" in seen["reason"]
        assert 15 <= seen["steps"] < 120
    assert seen["steps"] < 200


@pytest.mark.usefixtures("arms")
def test_a_killed_process_loses_next_to_nothing_that_was_recorded(
    targets: Path, tmp_path: Path
) -> None:
    player = play(targets, tmp_path)
    time.sleep(2.0)
    kill(player)
    assert len(recovered(tmp_path).sent) > 20
    again, _ = end_of(play(targets, tmp_path / "again"), tmp_path / "again")
    assert again["reason"] is None  # the arms can be reached again
