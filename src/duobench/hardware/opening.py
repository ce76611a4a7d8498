"""From a rig's file to a rig: each device by the driver that the file names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from duobench.hardware.clock import Clock, SystemClock
from duobench.hardware.devices import Arm, Camera, Gripper
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.guard import Guard
from duobench.hardware.rig import (
    ArmConfig,
    ArmDriver,
    CameraConfig,
    CameraDriver,
    GripperConfig,
    GripperDriver,
    Rig,
)
from duobench.references import load
from duobench.robot.joints import HOME_JOINTS
from duobench.types import SIDES, Side

SIMULATED = "simulated"
"""Name of the rig without hardware."""
_DRIVERS = "duobench.hardware.drivers"
_SIMULATED = f"{_DRIVERS}.simulated"
DRIVERS: Mapping[str, str] = {
    ArmDriver.FRANKY: f"{_DRIVERS}.franky_arm:FrankyArm",
    GripperDriver.ROBOTIQ: f"{_DRIVERS}.robotiq:RobotiqGripper",
    CameraDriver.REALSENSE: f"{_DRIVERS}.realsense:RealSenseCamera",
    CameraDriver.UVC: f"{_DRIVERS}.uvc:UvcCamera",
    CameraDriver.FILE: f"{_DRIVERS}.uvc:FileCamera",
}
"""Import paths of the drivers of hardware, each called with a device's configuration and a clock,
and a camera's with its name; their libraries are loaded when one is made."""


def open_rig(rig: Rig | Path | str, clock: Clock | None = None, *, guard: bool = True) -> FrankaDuo:
    """A rig, not connected yet: `start` does that.

    Args:
        rig: A rig, its file, or "simulated".
        clock: Its clock; the machine's own where none is given.
        guard: Whether our own simulation keeps the arms apart and off the table.

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
        arms={side: _arm(side, rig.arms[side], clock) for side in SIDES},
        grippers={side: _gripper(rig.grippers[side], clock) for side in SIDES},
        cameras={name: _camera(name, config, clock) for name, config in rig.cameras.items()},
        guard=Guard() if guard else None,
    )


def _load(path: str) -> Callable[..., Any]:
    return load(path, "driver", callable)


def _arm(side: Side, config: ArmConfig, clock: Clock) -> Arm:
    if config.driver is ArmDriver.SIMULATED:
        return _load(f"{_SIMULATED}:SimulatedArm")(clock, HOME_JOINTS[side.index])
    return _load(DRIVERS[config.driver])(config, clock)


def _gripper(config: GripperConfig, clock: Clock) -> Gripper:
    if config.driver is GripperDriver.SIMULATED:
        return _load(f"{_SIMULATED}:SimulatedGripper")(clock)
    return _load(DRIVERS[config.driver])(config, clock)


def _camera(name: str, config: CameraConfig, clock: Clock) -> Camera:
    if config.driver is CameraDriver.SIMULATED:
        return _load(f"{_SIMULATED}:SimulatedCamera")(clock, fps=config.fps)
    return _load(DRIVERS[config.driver])(config, clock, name)
