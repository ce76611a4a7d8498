"""Both arms by franky itself, against franky-sim in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.data import DataSet
from duobench.envs.protocol import make_env
from duobench.evaluation import rollout
from duobench.evaluation.policies import ExpertPolicy
from duobench.robot.joints import HOME_JOINTS

pytest.importorskip("franky", reason="franky-control is not installed; see `make test-hardware`")
pytest.importorskip("franky_sim", reason="franky-sim is not installed")
MEDIAN = 0.015
"""Largest median error of a joint in radians."""
HERE = "tests.hardware.with_libraries"


class Sent:
    """The targets of an episode."""

    def __init__(self) -> None:
        self.targets: list[np.ndarray] = []

    def on_episode_start(self, *_: Any) -> None: ...

    def on_step(self, step: Any) -> None:
        self.targets.append(step.info["sent"])

    def on_episode_end(self, *_: Any) -> None: ...


@pytest.fixture(scope="module")
def half_tempo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An expert's episode of bin_sort, each of its steps in two."""
    env, sent = make_env("bin_sort", cameras=False), Sent()
    rollout(env, ExpertPolicy(env), seed=0, watchers=[sent])
    env.close()
    ends = np.array(sent.targets)
    times = np.arange(0, len(ends) - 0.5, 0.5)
    path = tmp_path_factory.mktemp("targets") / "targets.npy"
    whole = [np.interp(times, np.arange(len(ends)), column) for column in ends.T]
    np.save(path, np.array(whole).T)
    return path


@pytest.fixture
def arms() -> Iterator[subprocess.Popen[str]]:
    homes = json.dumps(HOME_JOINTS.tolist())
    command = [sys.executable, "-m", f"{HERE}.arms", homes]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        assert server.stdout.readline() == "ready\n"
        yield server
        server.send_signal(signal.SIGCONT)
        server.kill()


def play(targets: Path, folder: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", f"{HERE}.play", str(targets), str(folder)]
    player = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert player.stdout is not None
    assert player.stdout.readline() == "home\n"
    return player


def end_of(player: subprocess.Popen[str]) -> dict[str, Any]:
    assert player.stdout is not None
    with player:
        seen = json.loads(player.stdout.readline())
        assert player.wait(60) == 0
    return seen


@pytest.mark.usefixtures("arms")
def test_both_arms_track_an_experts_episode_at_half_tempo(half_tempo: Path, tmp_path: Path) -> None:
    seen = end_of(play(half_tempo, tmp_path))
    assert seen["reason"] is None
    assert seen["steps"] > 200
    assert seen["median"] <= MEDIAN, seen
    assert {"q", "dq", "tau_J", "O_T_EE", "control_command_success_rate"} <= set(seen["arm_states"])
    (recording,) = DataSet.open(tmp_path).recordings()
    assert len(recording.sent) in {seen["steps"], seen["steps"] + 1}


def test_robots_that_are_gone_are_noticed_and_nothing_recorded_is_lost(
    arms: subprocess.Popen[str], half_tempo: Path, tmp_path: Path
) -> None:
    player = play(half_tempo, tmp_path)
    time.sleep(1.0)
    arms.send_signal(signal.SIGSTOP)
    seen = end_of(player)
    assert seen["fault_kind"] == "communication"
    assert "arm" in seen["reason"]
    assert 15 <= seen["steps"] < 120
    (recording,) = DataSet.open(tmp_path).recordings()
    assert recording.info.outcome is not None
    assert recording.info.outcome.reason == seen["reason"]
    assert len(recording.sent) >= seen["steps"]


@pytest.mark.usefixtures("arms")
def test_a_process_that_was_frozen_holds_both_arms_and_says_so(
    half_tempo: Path, tmp_path: Path
) -> None:
    player = play(half_tempo, tmp_path)
    time.sleep(1.0)
    player.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    player.send_signal(signal.SIGCONT)
    seen = end_of(player)
    assert seen["fault_kind"] == "communication"
    assert seen["reason"]
    assert seen["steps"] < 200
    (recording,) = DataSet.open(tmp_path).recordings()
    assert recording.info.outcome is not None
    assert recording.info.outcome.reason == seen["reason"]


@pytest.mark.usefixtures("arms")
def test_a_killed_process_loses_next_to_nothing_that_was_recorded(
    half_tempo: Path, tmp_path: Path
) -> None:
    player = play(half_tempo, tmp_path)
    time.sleep(2.0)
    os.kill(player.pid, signal.SIGKILL)
    with player:
        player.wait(10)
    data = DataSet.open(tmp_path)
    (partial,) = data.partials()
    data.recover(partial)
    (recording,) = data.recordings()
    assert len(recording.sent) > 20
    again = end_of(play(half_tempo, tmp_path / "again"))  # the arms can be reached again
    assert again["reason"] is None
