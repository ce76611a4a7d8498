"""From a rig's file to a rig: each device by the driver that the file names."""

from pathlib import Path
from typing import Any

from duobench.core.references import load
from duobench.core.types import POLICY_CAMERAS, SIDES
from duobench.real.clock import Clock, PacedClock, SystemClock
from duobench.real.duo import FrankaDuo
from duobench.real.guard import Guard
from duobench.real.rig import (
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
"""Drivers of hardware below `duobench.real.drivers`, each called with a device's configuration
and a clock, and a camera's with its name; their libraries are loaded when one is made."""


def open_rig(rig: Rig | Path | str, clock: Clock | None = None, *, guard: bool = True) -> FrankaDuo:
    """A rig, its file, "simulated" or "rehearsal", not connected yet: `start` does that.

    Without a clock it takes the machine's own, and a rehearsal a paced one. With a guard our own
    simulation keeps the arms apart and off the table.

    Raises:
        FileError: The file cannot be read, or is no rig.
    """
    if isinstance(rig, str) and rig in COMPUTED:
        rig = COMPUTED[rig]()
    elif not isinstance(rig, Rig):
        rig = Rig.read(Path(rig))
    is_rehearsal = REHEARSAL in rig.drivers
    clock = clock or (PacedClock() if is_rehearsal else SystemClock())
    rehearsal = _driver("rehearsal:Rehearsal")(clock) if is_rehearsal else None

    def made(config: Any, name: str) -> Any:
        """A device by its driver; the name is a camera's, or the side that it is on."""
        if config.driver == REHEARSAL and rehearsal is not None:
            return rehearsal.device(config, name)
        if config.driver == SIMULATED:
            return _driver("simulated:simulated_device")(config, clock, name)
        names = [name] if isinstance(config, CameraConfig) else []
        return _driver(DRIVERS[config.driver])(config, clock, *names)

    return FrankaDuo(
        rig,
        clock,
        arms={side: made(rig.arms[side], side) for side in SIDES},
        grippers={side: made(rig.grippers[side], side) for side in SIDES},
        cameras={name: made(config, name) for name, config in rig.cameras.items()},
        guard=Guard(rig.workspace, rig.obstacles) if guard else None,
        world=None if rehearsal is None else rehearsal.world,
    )


def _driver(path: str) -> Any:
    return load(f"duobench.real.drivers.{path}", "driver", callable)
