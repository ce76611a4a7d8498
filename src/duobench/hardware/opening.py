"""From a rig's file to a rig: each device by the driver that the file names."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from duobench.hardware.clock import Clock, SystemClock
from duobench.hardware.devices import Arm, Camera, Gripper
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.guard import Guard
from duobench.hardware.rig import (
    MAX_ACCELERATION,
    MAX_SPEED_FRACTION,
    MAX_TOOL_SPEED,
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
from duobench.types import POLICY_CAMERAS, SIDES, Side

SIMULATED, REHEARSAL = "simulated", "rehearsal"
REHEARSAL_SIZE = (180, 320)
"""Height and width in pixels of the images of a rehearsal: a quarter of native ones, which a
processor renders ten times a second beside the arms."""
REHEARSAL_FORCE = 60.0
"""Force in N at which an arm of a rehearsal stops: hands that pass a cube on press each other with
25 to 31 N [measured on the expert's commands]."""
REHEARSAL_MOMENT = 12.0
"""Moment in N·m at its tool at which it stops: a pot at the end of an arm turns the wrist."""


def rehearsal_rig() -> Rig:
    """A rig without hardware whose arms and grippers act on our own simulation of a task.

    Mounts are named by address and port, so that arms can be swapped as cables can.
    """
    arms = {
        side: ArmConfig(
            driver=ArmDriver.REHEARSAL,
            address=side,
            speed_fraction=MAX_SPEED_FRACTION,
            acceleration=MAX_ACCELERATION,
            tool_speed=MAX_TOOL_SPEED,
            force_threshold=REHEARSAL_FORCE,
            moment_threshold=REHEARSAL_MOMENT,
            is_realtime=False,
        )
        for side in SIDES
    }
    camera = CameraConfig(driver=CameraDriver.REHEARSAL, size=REHEARSAL_SIZE)
    return Rig(
        name="rehearsal",
        arms=arms,
        grippers={side: GripperConfig(driver=GripperDriver.REHEARSAL, port=side) for side in SIDES},
        cameras=dict.fromkeys(POLICY_CAMERAS, camera),
    )


COMPUTED = {SIMULATED: Rig.simulated, REHEARSAL: rehearsal_rig}
"""The rigs without hardware by their names."""
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
    """A rig, its file, "simulated" or "rehearsal", not connected yet: `start` does that.

    Without a clock it takes the machine's own. With a guard our own simulation keeps the arms apart
    and off the table.

    Raises:
        FileError: The file cannot be read, or is no rig.
    """
    clock = clock or SystemClock()
    if isinstance(rig, str) and rig in COMPUTED:
        rig = COMPUTED[rig]()
    elif not isinstance(rig, Rig):
        rig = Rig.read(Path(rig))
    rehearsal = None
    if REHEARSAL in rig.drivers:
        rehearsal = _driver("rehearsal:Rehearsal")(clock)
    return FrankaDuo(
        rig,
        clock,
        arms={side: _arm(rig, side, clock, rehearsal) for side in SIDES},
        grippers={side: _gripper(rig, side, clock, rehearsal) for side in SIDES},
        cameras={name: _camera(rig, name, clock, rehearsal) for name in rig.cameras},
        guard=Guard(rig.workspace, rig.obstacles) if guard else None,
        world=None if rehearsal is None else rehearsal.world,
    )


def _arm(rig: Rig, side: Side, clock: Clock, rehearsal: Any) -> Arm:
    config = rig.arms[side]
    if config.driver is ArmDriver.SIMULATED:
        return _driver("simulated:SimulatedArm")(clock, HOME_JOINTS[side.index])
    if config.driver is ArmDriver.REHEARSAL:
        return rehearsal.arm(config)
    return _driver(DRIVERS[config.driver])(config, clock)


def _gripper(rig: Rig, side: Side, clock: Clock, rehearsal: Any) -> Gripper:
    config = rig.grippers[side]
    if config.driver is GripperDriver.SIMULATED:
        return _driver("simulated:SimulatedGripper")(clock)
    if config.driver is GripperDriver.REHEARSAL:
        return rehearsal.gripper(config)
    return _driver(DRIVERS[config.driver])(config, clock)


def _camera(rig: Rig, name: str, clock: Clock, rehearsal: Any) -> Camera:
    config = rig.cameras[name]
    if config.driver is CameraDriver.SIMULATED:
        return _driver("simulated:SimulatedCamera")(clock, fps=config.fps)
    if config.driver is CameraDriver.REHEARSAL:
        return rehearsal.camera(config, name)
    return _driver(DRIVERS[config.driver])(config, clock, name)


def _driver(path: str) -> Callable[..., Any]:
    return load(f"duobench.hardware.drivers.{path}", "driver", callable)
