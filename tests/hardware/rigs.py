"""Rigs of simulated devices on a virtual clock."""

from __future__ import annotations

from typing import cast

import numpy as np

from duobench.hardware.clock import VirtualClock
from duobench.hardware.drivers.simulated import SimulatedArm, SimulatedCamera, SimulatedGripper
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.opening import open_rig
from duobench.hardware.rig import Rig
from duobench.robot.joints import HOME_JOINTS
from duobench.types import CONTROL_HZ, Array, DuoCommand, Side

PERIOD = 1.0 / CONTROL_HZ


def new_rig(rig: Rig | str = "simulated", *, guard: bool = False) -> FrankaDuo:
    """A simulated rig that is not started."""
    return open_rig(rig, VirtualClock(), guard=guard)


def ready_rig(rig: Rig | str = "simulated", *, guard: bool = False) -> FrankaDuo:
    """A simulated rig at home that waits for the first command."""
    duo = new_rig(rig, guard=guard)
    duo.start()
    duo.supervisor.confirm()
    duo.home()
    return duo


def arm(duo: FrankaDuo, side: Side) -> SimulatedArm:
    return cast("SimulatedArm", duo.arms[side])


def gripper(duo: FrankaDuo, side: Side) -> SimulatedGripper:
    return cast("SimulatedGripper", duo.grippers[side])


def camera(duo: FrankaDuo, name: str) -> SimulatedCamera:
    return cast("SimulatedCamera", duo.cameras[name])


def shifted(change: float, joint: int = 0) -> DuoCommand:
    """Home with one joint of both arms elsewhere."""
    joints = HOME_JOINTS.copy()
    joints[:, joint] += change
    return DuoCommand(joints=joints, openings=np.ones(2))


def wait(duo: FrankaDuo, seconds: float) -> None:
    """Let time pass in which nobody sends commands."""
    duo.clock.wait_until(duo.clock.now() + seconds)


def joints(duo: FrankaDuo) -> Array:
    """Where both arms are at this moment (2, 7)."""
    return np.array([reading.joints for reading in duo.readings().values()])


def speeds(duo: FrankaDuo) -> Array:
    """How fast both arms are at this moment (2, 7)."""
    return np.array([reading.velocities for reading in duo.readings().values()])
