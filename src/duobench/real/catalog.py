"""Drivers of arms, grippers and cameras, a row each; their modules are in `drivers`.

Libraries are imported when a device is made. A driver of one's own needs no row: a rig's file names
it as `module:NAME`.
"""

from dataclasses import dataclass
from typing import Any

from duobench.core.errors import OptionError, check_known
from duobench.core.references import load
from duobench.world.robot.gripper import DEFAULT_GRIPPER, GRIPPERS

FRANKY = "franky"
HARDWARE_GRIPPER = GRIPPERS[DEFAULT_GRIPPER].word
REHEARSAL = "rehearsal"
OWN = "module:NAME"
"""Form of the name of a driver that has no row."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Driver:
    """Driver of one kind of device."""

    path: str
    """Import path of its class, called with a device's configuration and the rig's clock, and for
    a camera with its name; that of a rehearsal makes all devices of a rig."""
    packages: tuple[str, ...] = ()
    """Names by which pip knows the libraries that it needs."""
    is_computed: bool = False
    """Whether it drives no hardware, so that its time may be computed too."""
    is_on_arm: bool = False
    """Whether a gripper is reached through the control box of its arm."""
    has_depth: bool = False
    """Whether a camera may measure depth."""


_REHEARSAL = Driver(
    path="duobench.real.drivers.rehearsal:Rehearsal",
    is_computed=True,
    has_depth=True,
)
DRIVERS: dict[str, dict[str, Driver]] = {
    "arms": {
        FRANKY: Driver(
            path="duobench.real.drivers.franky_arm:FrankyArm",
            packages=("franky-control",),
        ),
        REHEARSAL: _REHEARSAL,
    },
    "grippers": {
        **{
            gripper.word: Driver(
                path=gripper.driver,
                packages=gripper.libraries,
                is_on_arm=gripper.is_on_arm,
            )
            for gripper in GRIPPERS.values()
        },
        REHEARSAL: _REHEARSAL,
    },
    "cameras": {
        "realsense": Driver(
            path="duobench.real.drivers.realsense:RealSenseCamera",
            packages=("pyrealsense2",),
            has_depth=True,
        ),
        "uvc": Driver(path="duobench.real.drivers.uvc:UvcCamera"),
        "file": Driver(
            path="duobench.real.drivers.uvc:FileCamera",
            is_computed=True,
        ),
        REHEARSAL: _REHEARSAL,
    },
}
"""Drivers by the part of a rig that they drive and the name that a rig's file has for them."""


def check_driver(
    part: str,
    name: str,
    place: str,
) -> None:
    """Reject a name that has no row and is no `module:NAME`; nothing is imported.

    Args:
        part: Part of a rig: arms, grippers or cameras.
        name: Name of the driver.
        place: Place of the name in the rig's file, for the message.

    Raises:
        UnknownNameError: There is no such driver.
    """
    if ":" not in name:
        check_known(place, name, [*DRIVERS[part], OWN])


def check_depth(name: str, place: str) -> None:
    """Reject depth of a camera whose driver measures none; `module:NAME` is believed.

    Raises:
        OptionError: It measures none.
    """
    rows = DRIVERS["cameras"]
    if name in rows and not rows[name].has_depth:
        known = " and ".join(each for each, row in rows.items() if row.has_depth)
        raise OptionError(
            f"{place}.depth: the driver {name} gives colour alone; depth is measured by {known}."
        )


def load_driver(part: str, name: str) -> Any:
    """Import the driver of a name.

    Raises:
        ImportPathError: A `module:NAME` has another form, or its module cannot be imported.
        UnknownNameError: The module has nothing of that name that can be called.
    """
    row = DRIVERS[part].get(name)
    return load(name if row is None else row.path, f"driver of {part}", callable)


def is_computed(part: str, name: str) -> bool:
    """Whether a driver drives no hardware; one that has no row says so by `is_computed = True`."""
    row = DRIVERS[part].get(name)
    if row is not None:
        return row.is_computed
    return getattr(load_driver(part, name), "is_computed", False) is True
