"""Plays and records an episode on simulated devices in real time; run as a program.

`python -m tests.real.play_slowly DATA` prints `begun` after ten steps, and at the end what it
saw.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from duobench.data import Recorder
from duobench.real.env import make_real_env
from duobench.real.opening import open_rig
from tests.real.programs import say


def main() -> None:
    duo = open_rig("simulated", guard=False)
    env = Recorder(make_real_env(duo, "bin_sort", cameras=False), Path(sys.argv[1]))
    duo.supervisor.confirm()
    action, steps, truncated, info = env.reset(seed=0)[0]["agent_pos"], 0, False, {}
    while not truncated and steps < 300:
        *_, truncated, info = env.step(action)
        steps += 1
        if steps == 10:
            say("begun")
    env.close()
    seen = {"reason": info.get("truncation_reason"), "fault_kind": info.get("fault_kind")}
    say(json.dumps({**seen, "steps": steps}))


if __name__ == "__main__":
    main()
