"""Two arms of franky-sim at 127.0.0.1 and 127.0.0.2, in a process of their own.

Run as a program with the joint positions of both arms as JSON; it prints a line when it answers.
"""

from __future__ import annotations

import json
import os
import sys


def become_realtime(priority: int) -> bool:
    """Take precedence over other programs, as a robot computer does; whether that is allowed."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, PermissionError):
        return False
    return True


def main() -> None:
    import franky_sim
    from franky_sim.mujoco_simulator import MujocoSimulator

    become_realtime(20)
    with MujocoSimulator(enable_visualization=False) as simulator:
        for number, joints in enumerate(json.loads(sys.argv[1])):
            simulator.add_robot(initial_q=tuple(joints), position=(0.0, 2.0 * number, 0.0))
        addresses = ["127.0.0.1", "127.0.0.2"]
        with franky_sim.SimulationServer(simulator, hostname_candidates=addresses) as server:
            sys.stdout.write("ready\n")
            sys.stdout.flush()
            server.run_forever()


if __name__ == "__main__":
    main()
