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
        physics="mujoco",
        enforce_comm_constraints=True,
        enforce_motion_limits=True,
    ).start()


if __name__ == "__main__":
    main()
