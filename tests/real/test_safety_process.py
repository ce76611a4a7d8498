"""Safety rule 6 for our own process: frozen and killed, in real time."""

from __future__ import annotations

import signal
import time
from pathlib import Path

from duobench.real.watchdog import MAX_FREEZE_S
from tests.children import printed
from tests.real.programs import begun, end_of, kill, recovered


def test_a_process_that_was_frozen_holds_both_arms_and_records_why(tmp_path: Path) -> None:
    process = begun("play_slowly", "begun", tmp_path)
    process.send_signal(signal.SIGSTOP)
    time.sleep(5 * MAX_FREEZE_S)
    process.send_signal(signal.SIGCONT)
    seen, recording = end_of(process, tmp_path)
    assert seen["reason"].startswith("This computer stood still for")
    assert seen["fault_kind"] == "communication"
    assert len(recording.sent) >= 10


FIRST_STEP = """
import sys
from duobench.real.env import make_real_env
from duobench.real.opening import open_rig
from tests.real.simulated import simulated_rig
duo = open_rig(simulated_rig(), guard=False)
env = make_real_env(duo, "bin_sort", cameras=False)
duo.supervisor.confirm()
action = env.reset(seed=0)[0]["agent_pos"]
before = set(sys.modules)
env.step(action)
print(sorted(set(sys.modules) - before))
env.close()
"""


def test_the_first_step_imports_nothing_while_the_arms_wait() -> None:
    assert printed(FIRST_STEP) == "[]\n"


def test_nothing_but_a_moment_is_lost_of_what_a_killed_process_recorded(tmp_path: Path) -> None:
    kill(begun("play_slowly", "begun", tmp_path))
    recording = recovered(tmp_path)
    assert recording.info.outcome is not None
    assert recording.info.outcome.cut
    assert len(recording.sent) >= 1
