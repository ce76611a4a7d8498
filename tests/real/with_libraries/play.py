"""Plays targets on the arms of franky-sim and records what happens; run as a program.

`python -m tests.real.with_libraries.play TARGETS.npy DATA` plays the targets (n, 16) once, with
simulated grippers and cameras, and prints a line for each event: `home` when it begins, and at the
end what it saw as JSON.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from duobench.core.types import SIDES
from duobench.data import Recorder
from duobench.real.env import make_real_env
from duobench.real.opening import open_rig
from duobench.real.rig import MAX_ACCELERATION, MAX_SPEED_FRACTION
from tests.real.programs import say
from tests.real.with_libraries.arms import become_realtime
from tests.real.with_libraries.leading import franky_rig


def main() -> None:
    targets, folder = np.load(sys.argv[1]), Path(sys.argv[2])
    is_realtime = become_realtime(15)
    rig = franky_rig(speed_fraction=MAX_SPEED_FRACTION, acceleration=MAX_ACCELERATION)
    duo = open_rig(rig)
    env = Recorder(make_real_env(duo, "bin_sort", horizon=len(targets), cameras=False), folder)
    duo.supervisor.confirm()
    env.reset(seed=0)
    say("home")
    errors, late, info = [], [], {}
    for target in targets:
        observation, *_, info = env.step(target)
        off = np.abs(observation["agent_pos"] - info["sent"]).reshape(2, 8)[:, :7]
        errors.append(off)
        late.append(info["late_s"])
        if "truncation_reason" in info:
            break
    seen = {
        "median": float(np.median(errors)),
        "largest": float(np.max(errors)),
        "steps": len(errors),
        "late": float(np.max(late)),
        "is_realtime": is_realtime,
        "reason": info.get("truncation_reason"),
        "fault_kind": info.get("fault_kind"),
        "arm_states": sorted(duo.readings()[SIDES[0]].state),
        "is_tracking": [reading.is_tracking for reading in duo.readings().values()],
    }
    env.close()
    say(json.dumps(seen))


if __name__ == "__main__":
    main()
