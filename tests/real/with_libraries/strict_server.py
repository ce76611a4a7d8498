"""One arm of franka-sim, with the limits of an arm and of its network enforced; a program.

`python strict_server.py ADDRESS JOINTS` serves it at an address; it begins at the joint positions,
given as JSON. It runs in franka-sim's own environment, so it needs nothing of ours but the model,
whose file FR3_MJCF names.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import sys
import threading
import time
from typing import Any

STEP_S, ALONE_S = 0.001, 0.05
"""A step of the arm, and without whom for how long it goes on by itself, in seconds."""


def in_step(plain: Any) -> Any:
    """The arm's motion, a millisecond for each state that is sent.

    On its own thread it goes on while a busy machine holds up what was answered, which no arm does:
    then commands come late although none is counted as lost. So a slow machine makes a slow arm.
    """

    class InStep(plain):  # type: ignore[misc]
        _lock = threading.Lock()
        _last = 0.0

        def get_robot_state(self) -> Any:
            with self._lock:
                self._last = time.monotonic()
                self.step()
                return super().get_robot_state()

        def run_simulation(self) -> None:
            """Go on by itself while nobody is connected, as long as the program runs."""
            self._read_and_publish_state()
            while self.running:
                time.sleep(STEP_S)
                if time.monotonic() - self._last > ALONE_S:
                    with self._lock:
                        self.step()

    return InStep


def main() -> None:
    address, joints = sys.argv[1], json.loads(sys.argv[2])
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    logging.basicConfig(level=logging.INFO)
    from franka_sim import FrankaSimServer, mujoco_franka_sim

    mujoco_franka_sim.ARM_INITIAL_Q[:] = joints
    FrankaSimServer(
        host=address,
        enable_gripper=False,
        physics_sim=in_step(mujoco_franka_sim.MujocoFrankaSim)(),
        enforce_comm_constraints=True,
        enforce_motion_limits=True,
    ).start()


if __name__ == "__main__":
    main()
