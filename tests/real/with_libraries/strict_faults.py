"""Moves both arms of franka-sim, has something go wrong, and says what the arms do; a program.

`python -m tests.real.with_libraries.strict_faults NAME DATA` records an episode in which both
arms swing together, and prints `moving` when they are fast. Then it strikes what NAME says, waits
until the episode ends, recovers and goes home. At the end it prints what it saw as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from duobench.core.types import CONTROL_HZ, SIDES, Array, DuoCommand, Side
from duobench.data import Recorder
from duobench.real import watchdog
from duobench.real.duo import FrankaDuo
from duobench.real.env import make_real_env
from duobench.real.opening import open_rig
from duobench.world.robot.mounts import HOME_JOINTS
from tests.real.programs import say
from tests.real.rigs import camera, gripper
from tests.real.with_libraries.arms import become_realtime
from tests.real.with_libraries.leading import franky_rig, recover

SWING, PACE = 0.25, 2.0
"""The swing of every joint in radians, and how fast it is in rad/s: at most 0.5 rad/s."""
FAST = 24
"""The step after which the swing is fastest."""
STEPS = 600
RESTING = 0.1
"""Speed in rad/s below which an arm stands still: the last joint of a simulator whose arm stopped
by itself hums at 0.08."""
SOON_S = 2.0
"""What stands for the half minute after which arms stop, damped."""


def stall(duo: FrankaDuo) -> None:
    """Say nothing for longer than the arms wait."""
    watchdog.STOP_AFTER_S = SOON_S  # pyright: ignore[reportAttributeAccessIssue]
    time.sleep(SOON_S / 2)
    assert max(speeds(duo)) < RESTING / 10  # at rest at the last target, and still held there
    assert all(reading.is_tracking for reading in duo.readings().values())
    time.sleep(SOON_S)


def jump(duo: FrankaDuo) -> None:
    """Tell the left arm itself to be elsewhere, as no follower would, until it has a reflex."""
    end = time.monotonic() + 5.0
    while duo.held is None and time.monotonic() < end:
        far = HOME_JOINTS[0] + 0.5 * np.sign(np.sin(20.0 * time.monotonic()))
        duo.arms[Side.LEFT].command(far, np.zeros(7))
        time.sleep(0.0005)


STRIKES: dict[str, Callable[[FrankaDuo], None]] = {
    "stall": stall,
    "gripper": lambda duo: setattr(gripper(duo, Side.RIGHT), "is_silent", True),
    "camera": lambda duo: setattr(camera(duo, "head"), "is_silent", True),
    "jump": jump,
    "person": lambda duo: duo.hold("The button on the page."),
    "nothing": lambda _: None,  # from outside: frozen, or killed
}


def target(number: int) -> Array:
    swing = SWING * (1.0 - np.cos(PACE * number / CONTROL_HZ))
    return DuoCommand(joints=HOME_JOINTS + swing, openings=np.ones(2)).flat


def speeds(duo: FrankaDuo) -> list[float]:
    return [float(np.abs(reading.velocities).max()) for reading in duo.readings().values()]


def wait_for_rest(duo: FrankaDuo) -> float:
    """Wait until both arms stand still, and go on to; the seconds that it took."""
    begun = still = time.monotonic()
    while time.monotonic() - still < 0.5 and still - begun < 10.0:
        time.sleep(0.02)
        if max(speeds(duo)) >= RESTING:
            still = time.monotonic()
    return still - begun


def play(env: Recorder, duo: FrankaDuo, name: str) -> tuple[int, list[float], dict[str, Any]]:
    """Steps until the episode's end, the speeds when it was struck, and the last info."""
    before: list[float] = []
    info: dict[str, Any] = {}
    for number in range(STEPS):
        *_, is_over, info = env.step(target(number))
        if is_over:
            return number + 1, before, info
        if number == FAST:
            before = speeds(duo)
            say("moving")
            STRIKES[name](duo)
    return STEPS, before, info


def main() -> None:
    name, folder = sys.argv[1], Path(sys.argv[2])
    become_realtime(15)
    duo = open_rig(franky_rig(cameras=("head",)), guard=False)
    seen_by = {"cameras": ("head",), "image_size": (24, 32)}
    plain = make_real_env(duo, "bin_sort", horizon=STEPS, **seen_by)
    env = Recorder(plain, folder)
    duo.supervisor.confirm()
    env.reset(seed=0)
    steps, before, info = play(env, duo, name)
    rest_s = wait_for_rest(duo)
    readings = [duo.readings()[side] for side in SIDES]
    gripper(duo, Side.RIGHT).is_silent = camera(duo, "head").is_silent = False
    recover(duo)
    duo.home()
    seen = {
        "steps": steps,  # that the environment was asked for
        "reason": info.get("truncation_reason"),
        "fault_kind": info.get("fault_kind"),
        "speed_before": before,  # largest one of a joint when it was struck, left then right
        "rest_s": rest_s,  # from the episode's end until both arms stood still
        # Of each arm then, left then right: whether it followed its reference, and what was wrong.
        "is_tracking": [reading.is_tracking for reading in readings],
        "errors": ["" if reading.fault is None else reading.fault.text for reading in readings],
        "state": str(duo.supervisor.state),  # after the rig was recovered and sent home
    }
    env.close()
    say(json.dumps(seen))


if __name__ == "__main__":
    main()
