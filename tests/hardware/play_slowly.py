"""Plays and records an episode on simulated devices in real time; run as a program.

`python -m tests.hardware.play_slowly DATA` prints `begun` after ten steps, and at the end why the
episode ended.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from duobench.data import Recorder
from duobench.hardware.env import make_real_env
from duobench.hardware.opening import open_rig


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main() -> None:
    duo = open_rig("simulated", guard=False)
    env = Recorder(make_real_env(duo, "bin_sort", cameras=False), Path(sys.argv[1]))
    duo.supervisor.confirm()
    action = env.reset(seed=0)[0]["agent_pos"]
    for number in range(300):
        *_, truncated, info = env.step(action)
        if number == 10:
            say("begun")
        if truncated:
            break
    env.close()
    say(json.dumps([info.get("truncation_reason"), info.get("fault_kind"), str(duo.held)]))


if __name__ == "__main__":
    main()
