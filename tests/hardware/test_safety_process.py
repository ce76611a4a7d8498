"""Safety rule 6 for our own process: frozen and killed, in real time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from duobench.data import DataSet
from duobench.hardware.watchdog import MAX_FREEZE_S

ROOT = Path(__file__).parents[2]


def player(folder: Path) -> subprocess.Popen[str]:
    """A process that plays and records, ten steps after its beginning."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    command = [sys.executable, "-m", "tests.hardware.play_slowly", str(folder)]
    begun = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)
    assert begun.stdout is not None
    if begun.stdout.readline() != "begun\n":  # a busy machine froze it before we could
        begun.kill()
        with begun:
            pass
        pytest.fail("The process did not come as far as ten steps.")
    return begun


def test_a_process_that_was_frozen_holds_both_arms_and_records_why(tmp_path: Path) -> None:
    process = player(tmp_path)
    assert process.stdout is not None
    process.send_signal(signal.SIGSTOP)
    time.sleep(5 * MAX_FREEZE_S)
    process.send_signal(signal.SIGCONT)
    with process:
        reason, kind, _ = json.loads(process.stdout.readline())
    assert reason.startswith("This computer stood still for")
    assert kind == "communication"
    (recording,) = DataSet.open(tmp_path).recordings()
    assert recording.info.outcome is not None
    assert recording.info.outcome.reason == reason
    assert len(recording.sent) >= 10


def test_nothing_but_a_moment_is_lost_of_what_a_killed_process_recorded(tmp_path: Path) -> None:
    process = player(tmp_path)
    process.kill()
    with process:
        process.wait(10)
    data = DataSet.open(tmp_path)
    (partial,) = data.partials()
    data.recover(partial)
    (recording,) = data.recordings()
    assert recording.info.outcome is not None
    assert recording.info.outcome.cut
    assert len(recording.sent) >= 1
