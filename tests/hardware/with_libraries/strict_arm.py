"""Plays random targets on an arm of franka-sim, which enforces limits; run as a program.

`python -m tests.hardware.with_libraries.strict_arm COUNT` leads a left arm at 127.0.0.1, with a
simulated right one, as a new rig's file does; at the end it prints what it saw as JSON. With a
count of 0 it jumps instead, which trips a reflex, recovers and goes home.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace

import numpy as np

from duobench.hardware.duo import HardwareDuo
from duobench.hardware.opening import open_rig
from duobench.hardware.rig import ArmConfig, ArmDriver, Rig
from duobench.robot.joints import HOME_JOINTS
from duobench.types import DuoCommand, Side
from tests.hardware.with_libraries.arms import become_realtime

TRIES = 20


def rig() -> Rig:
    plain = Rig.simulated()
    left = ArmConfig(driver=ArmDriver.FRANKY, address="127.0.0.1", is_realtime=False)
    return replace(plain, arms={**plain.arms, Side.LEFT: left}, cameras={})


def recover(duo: HardwareDuo) -> None:
    """Recover as an operator does who waits until the arm stands still."""
    for _ in range(TRIES):
        try:
            duo.supervisor.recover()
            duo.supervisor.confirm()
        except Exception:  # noqa: BLE001 - tried again
            time.sleep(0.5)
        else:
            return


def play(duo: HardwareDuo, count: int) -> list[tuple[str, str]]:
    """Random targets, some near and some at the ends of the range; returns all faults."""
    rng, goal, faults = np.random.default_rng(0), HOME_JOINTS, []
    for number in range(count):
        if number % 15 == 0:
            goal = HOME_JOINTS + rng.uniform(-0.6, 0.6, (2, 7))
        if rng.random() < 0.1:
            goal = HOME_JOINTS + rng.uniform(-3.0, 3.0, (2, 7))
        duo.command(DuoCommand(joints=goal, openings=np.ones(2)))
        if duo.held:
            faults.append((str(duo.fault and duo.fault.kind), duo.held))
            recover(duo)
    return faults


def jump(duo: HardwareDuo) -> list[tuple[str, str]]:
    """Tell the arm itself to be elsewhere, as no follower would."""
    command = DuoCommand(joints=HOME_JOINTS, openings=np.ones(2))
    duo.command(command)
    end = time.monotonic() + 5.0
    while duo.held is None and time.monotonic() < end:
        far = HOME_JOINTS[0] + 0.5 * np.sign(np.sin(20.0 * time.monotonic()))
        duo.arms[Side.LEFT].command(far, np.zeros(7))
        duo.clock.wait_until(duo.clock.now() + 0.0005)
    fault, held = duo.fault, duo.held
    still = [reading.is_tracking for reading in duo.readings().values()]
    recover(duo)
    duo.home()
    return [(str(fault and fault.kind), str(held)), (str(duo.supervisor.state), str(still))]


def main() -> None:
    become_realtime(15)
    duo = open_rig(rig(), guard=False)
    duo.start()
    duo.supervisor.confirm()
    duo.home()
    count = int(sys.argv[1])
    faults = play(duo, count) if count else jump(duo)
    duo.close()
    sys.stdout.write(json.dumps(faults) + "\n")


if __name__ == "__main__":
    main()
