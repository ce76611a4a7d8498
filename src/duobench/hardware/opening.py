"""From a rig's file to a rig: each device by the driver that the file names."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from duobench.hardware.clock import Clock, SystemClock
from duobench.hardware.devices import Arm, Camera, Gripper
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.guard import Guard
from duobench.hardware.rig import ArmDriver, CameraDriver, GripperDriver, Rig
from duobench.references import load
from duobench.robot.joints import HOME_JOINTS
from duobench.types import SIDES, Side

SIMULATED = "simulated"
"""Name of the rig without hardware."""
DRIVERS = {
    ArmDriver.FRANKY: "franky_arm:FrankyArm",
    GripperDriver.ROBOTIQ: "robotiq:RobotiqGripper",
    CameraDriver.REALSENSE: "realsense:RealSenseCamera",
    CameraDriver.UVC: "uvc:UvcCamera",
    CameraDriver.FILE: "uvc:FileCamera",
}
"""Drivers of hardware below `duobench.hardware.drivers`, each called with a device's configuration
and a clock, and a camera's with its name; their libraries are loaded when one is made."""


def open_rig(rig: Rig | Path | str, clock: Clock | None = None, *, guard: bool = True) -> FrankaDuo:
    """A rig, its file or "simulated", not connected yet: `start` does that.

    Without a clock it takes the machine's own. With a guard our own simulation keeps the arms apart
    and off the table.

    Raises:
        FileError: The file cannot be read, or is no rig.
    """
    clock = clock or SystemClock()
    if rig == SIMULATED:
        rig = Rig.simulated()
    elif not isinstance(rig, Rig):
        rig = Rig.read(Path(rig))
    return FrankaDuo(
        rig,
        clock,
        arms={side: _arm(rig, side, clock) for side in SIDES},
        grippers={side: _gripper(rig, side, clock) for side in SIDES},
        cameras={name: _camera(rig, name, clock) for name in rig.cameras},
        guard=Guard() if guard else None,
    )


def _arm(rig: Rig, side: Side, clock: Clock) -> Arm:
    config = rig.arms[side]
    if config.driver is ArmDriver.SIMULATED:
        return _driver("simulated:SimulatedArm")(clock, HOME_JOINTS[side.index])
    return _driver(DRIVERS[config.driver])(config, clock)


def _gripper(rig: Rig, side: Side, clock: Clock) -> Gripper:
    config = rig.grippers[side]
    if config.driver is GripperDriver.SIMULATED:
        return _driver("simulated:SimulatedGripper")(clock)
    return _driver(DRIVERS[config.driver])(config, clock)


def _camera(rig: Rig, name: str, clock: Clock) -> Camera:
    config = rig.cameras[name]
    if config.driver is CameraDriver.SIMULATED:
        return _driver("simulated:SimulatedCamera")(clock, fps=config.fps)
    return _driver(DRIVERS[config.driver])(config, clock, name)


def _driver(path: str) -> Callable[..., Any]:
    return load(f"duobench.hardware.drivers.{path}", "driver", callable)
