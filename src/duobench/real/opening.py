"""Opening of a rig from its file: each device by the driver that the file names."""

from pathlib import Path
from typing import Any

from duobench.core.errors import DuoBenchError, ImportPathError, traceback_text
from duobench.core.types import SIDES
from duobench.real.catalog import REHEARSAL, load_driver
from duobench.real.clock import Clock, PacedClock, SystemClock
from duobench.real.devices import Arm, Camera, Gripper
from duobench.real.duo import FrankaDuo
from duobench.real.guard import Guard
from duobench.real.rig import (
    MAX_ACCELERATION,
    MAX_SPEED_FRACTION,
    MAX_TOOL_SPEED,
    ArmConfig,
    CameraConfig,
    GripperConfig,
    Rig,
)
from duobench.world.robot.cameras import CAMERAS, D405
from duobench.world.robot.gripper import DEFAULT_GRIPPER
from duobench.world.robot.mounts import DEFAULT_MOUNT

REHEARSAL_SIZE = (180, 320)
"""Height and width in pixels of the images of a rehearsal: a quarter of native ones, which a
processor renders ten times a second beside the arms."""
REHEARSAL_FORCE = 60.0
"""Force in N at which an arm of a rehearsal stops: hands that pass a cube on press each other with
25 to 31 N [measured on the expert's commands]."""
REHEARSAL_MOMENT = 12.0
"""Moment in N·m at its tool at which it stops: a pot at the end of an arm turns the wrist."""


def rehearsal_rig(gripper: str = DEFAULT_GRIPPER, mount: str = DEFAULT_MOUNT) -> Rig:
    """A rig without hardware whose arms and grippers act on our own simulation of a task.

    Mounts are named by address and port, so that arms can be swapped as cables can.
    """
    arms = {
        side: ArmConfig(
            driver=REHEARSAL,
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
    cameras = {
        camera.name: CameraConfig(
            driver=REHEARSAL, size=REHEARSAL_SIZE, depth=camera.kind == D405
        )
        for camera in CAMERAS.values()
    }
    return Rig(
        name="rehearsal",
        arms=arms,
        grippers={side: GripperConfig(driver=REHEARSAL, port=side) for side in SIDES},
        cameras=cameras,
        gripper=gripper,
        mount=mount,
    )


_PROTOCOLS = {"arms": Arm, "grippers": Gripper, "cameras": Camera}


def open_rig(
    rig: Rig | Path | str, clock: Clock | None = None, *, guard: bool = True
) -> FrankaDuo:
    """A rig, its file, or "rehearsal", not connected yet: `start` does that.

    Without a clock it takes the machine's own, and a rehearsal a paced one. With a guard our own
    simulation keeps the arms apart and off the table.

    Raises:
        FileError: The file cannot be read, or is no rig.
        DuoBenchError: A driver of one's own cannot be imported, or makes no such device.
    """
    if rig == REHEARSAL:
        rig = rehearsal_rig()
    elif not isinstance(rig, Rig):
        rig = Rig.read(Path(rig))
    rig.check_computed()
    is_rehearsal = REHEARSAL in rig.drivers
    clock = clock or (PacedClock() if is_rehearsal else SystemClock())
    rehearsal = (
        load_driver("arms", REHEARSAL)(clock, rig.robot) if is_rehearsal else None
    )
    made: dict[str, dict[str, Any]] = {"arms": {}, "grippers": {}, "cameras": {}}
    for part, name, config in rig.devices():
        if config.driver == REHEARSAL and rehearsal is not None:
            made[part][name] = rehearsal.device(config, name)
        else:
            made[part][name] = _device(part, name, config, clock)
    return FrankaDuo(
        rig,
        clock,
        arms={side: made["arms"][side] for side in SIDES},
        grippers={side: made["grippers"][side] for side in SIDES},
        cameras=made["cameras"],
        guard=Guard(rig.robot, rig.workspace, rig.obstacles) if guard else None,
        world=None if rehearsal is None else rehearsal.world,
    )


def _device(
    part: str,
    name: str,
    config: ArmConfig | GripperConfig | CameraConfig,
    clock: Clock,
) -> Any:
    """A device by the driver that its configuration names.

    Raises:
        ImportPathError: The driver raises an error, or makes something else.
    """
    driver = load_driver(part, config.driver)
    given = [name] if isinstance(config, CameraConfig) else []
    try:
        device = driver(config, clock, *given)
    except DuoBenchError:
        raise
    except Exception as error:  # foreign code runs here
        raise ImportPathError(
            f"{part}.{name}.driver {config.driver!r} makes no device. It is called with the "
            "device's configuration and the rig's clock, and for a camera with its name.\n"
            f"{traceback_text(error, skip=1).strip()}"
        ) from error
    protocol = _PROTOCOLS[part]
    asked = [each for each in dir(protocol) if not each.startswith("_")]
    missing = [each for each in asked if each not in dir(device)]
    if missing:
        raise ImportPathError(
            f"{part}.{name}.driver {config.driver!r} makes something without "
            f"{', '.join(missing)}; the driver of {part} makes what has {', '.join(asked)} "
            f"(duobench.real.devices.{protocol.__name__})."
        )
    return device
