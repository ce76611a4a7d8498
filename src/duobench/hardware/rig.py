"""A rig: two arms, grippers and cameras of one lab, as one file, `rig.json`.

Addresses, serial numbers, gains, thresholds, gripper ends and calibration change results, so the
hash of the rig stands in every episode that was played on it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import msgspec

from duobench import files
from duobench.errors import FileError, OptionError
from duobench.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from duobench.types import ARM_JOINTS, POLICY_CAMERAS, SIDES, Side

RIG_SCHEMA = 1
"""Version of the file; raised when a field changes its meaning."""
FOLLOWER_HZ = 500.0
"""Rate at which an arm is told where to be [measured: 8 mrad behind, no reflex]."""
MAX_ACCELERATION = 6.0
"""Largest joint acceleration in rad/s² that a rig allows: at 9 arms overshot their speed limits in
a strict simulator of the robot, at 6 they did not [docs/real_safety.md; data sheet: 10]."""
MAX_SPEED_FRACTION = 0.5
"""Largest part of the joints' speed limits that a rig may allow."""
_STIFFNESS = (600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0)
_DAMPING = (50.0, 50.0, 50.0, 50.0, 30.0, 25.0, 15.0)
_LARGEST = {
    **dict.fromkeys(("speed_fraction", "home_fraction"), MAX_SPEED_FRACTION),
    "acceleration": MAX_ACCELERATION,
    **dict.fromkeys(("torque_threshold", "force_threshold"), 100.0),
}
"""Numbers of an arm that are over 0, and their largest values."""
MEASURED = ("name", "open_count", "closed_count", "calibration")
"""Fields of the file that may change while a rig stays the same: it is called otherwise, or its
grippers' ends, lenses and mounts are measured again."""
UNPOSED = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""The pose of a camera whose lens alone is known."""


class ArmDriver(StrEnum):
    """What talks to an arm."""

    FRANKY = "franky"
    SIMULATED = "simulated"


class GripperDriver(StrEnum):
    """What talks to a gripper."""

    ROBOTIQ = "robotiq"
    SIMULATED = "simulated"


class CameraDriver(StrEnum):
    """What talks to a camera."""

    REALSENSE = "realsense"
    UVC = "uvc"
    FILE = "file"
    SIMULATED = "simulated"


@dataclass(frozen=True, kw_only=True, slots=True)
class ArmConfig:
    """One arm."""

    driver: ArmDriver = ArmDriver.FRANKY
    address: str = ""
    """Host name or address of its control box."""
    stiffness: tuple[float, ...] = _STIFFNESS
    """Stiffness of each joint in N·m/rad [libfranka's example of joint impedance]."""
    damping: tuple[float, ...] = _DAMPING
    """Damping of each joint in N·m·s/rad [likewise]."""
    torque_threshold: float = 20.0
    """Joint torque in N·m at which the arm stops with a reflex [the library's default: low]."""
    force_threshold: float = 30.0
    """Force at the tool in N at which it does [likewise]."""
    speed_fraction: float = 0.25
    """Part of the joints' speed limits that it moves with at most."""
    acceleration: float = 4.0
    """Largest acceleration of its joints in rad/s²."""
    home_fraction: float = 0.1
    """Part of the joints' speed limits with which it goes home."""
    is_realtime: bool = True
    """Whether the computer must run a realtime kernel."""

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping"):
            values = getattr(self, name)
            if len(values) != ARM_JOINTS or not all(
                math.isfinite(value) and value > 0 for value in values
            ):
                raise OptionError(f"{name} is {ARM_JOINTS} positive numbers, got {values}.")
        for name, most in _LARGEST.items():
            if not 0.0 < (value := getattr(self, name)) <= most:
                raise OptionError(f"{name} is over 0 and at most {most:g}, got {value}.")


@dataclass(frozen=True, kw_only=True, slots=True)
class GripperConfig:
    """One gripper."""

    driver: GripperDriver = GripperDriver.ROBOTIQ
    port: str = ""
    """Serial port, best by its id: /dev/serial/by-id/…"""
    open_count: int = 3
    """Position, 0 to 255, that it reports when it is open and empty; measure it."""
    closed_count: int = 228
    """Position that it reports when it is closed and empty; measure it."""
    speed: int = 255
    """Speed, 0 to 255 for 20 to 150 mm/s."""
    force: int = 128
    """Force, 0 to 255 for 20 to 235 N."""

    def __post_init__(self) -> None:
        for name in ("open_count", "closed_count", "speed", "force"):
            if not 0 <= getattr(self, name) <= 255:  # noqa: PLR2004 - one byte
                raise OptionError(f"{name} is 0 to 255, got {getattr(self, name)}.")
        if self.open_count >= self.closed_count:
            raise OptionError(
                "closed_count is larger than open_count, since positions count from open; got "
                f"{self.closed_count} and {self.open_count}."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraCalibration:
    """Lens and mount of one camera, measured."""

    fx: float
    """Focal length across, in pixels."""
    fy: float
    """Focal length down, in pixels."""
    cx: float
    """Principal point across, in pixels; the middle of the leftmost one is 0."""
    cy: float
    """Principal point down, in pixels."""
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """OpenCV's k1, k2, p1, p2, k3."""
    pose: tuple[float, ...]
    """Pose x y z qx qy qz qw, in metres, of the camera (x right, y down, z forwards) in its parent:
    the table for the head, the flange for a wrist."""
    method: str = ""
    views: int = 0
    """Number of images that it was measured from."""
    error_px: float | None = None
    """Error in pixels on images that were held out."""
    opencv: str = ""
    date: str = ""

    def __post_init__(self) -> None:
        if len(self.pose) != 7 or len(self.distortion) != 5:  # noqa: PLR2004
            raise OptionError("A pose has 7 numbers, x y z qx qy qz qw, and a distortion 5.")


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraConfig:
    """One camera."""

    driver: CameraDriver
    device: str = ""
    """Serial number, device file, or file of images."""
    size: tuple[int, int] = (NATIVE_HEIGHT, NATIVE_WIDTH)
    """Height and width of its images in pixels."""
    fps: int = 30
    is_side_by_side: bool = False
    """Whether it gives two lenses beside each other, as a ZED Mini does: the left one is kept."""
    exposure_us: float | None = None
    """Exposure in microseconds; None leaves it to the camera, which varies it."""
    gain: float | None = None
    """Gain in the camera's units."""
    calibration: CameraCalibration | None = None
    """Lens and mount; None until they were measured."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Rig:
    """Everything about one lab's arms that is chosen or measured."""

    name: str
    """Name of the lab or of the robot."""
    arms: Mapping[Side, ArmConfig]
    grippers: Mapping[Side, GripperConfig]
    cameras: Mapping[str, CameraConfig] = field(
        default_factory=lambda: dict.fromkeys(
            POLICY_CAMERAS, CameraConfig(driver=CameraDriver.SIMULATED)
        )
    )
    """The cameras by name; some may be missing."""
    schema: int = RIG_SCHEMA

    def __post_init__(self) -> None:
        if self.schema != RIG_SCHEMA:
            raise OptionError(f"Rigs of schema {RIG_SCHEMA} are known, got {self.schema}.")
        for what, devices in (("arms", self.arms), ("grippers", self.grippers)):
            if set(devices) != set(SIDES):
                raise OptionError(f"A rig has {what} left and right, got {sorted(devices)}.")
        for name in self.cameras:
            if name not in POLICY_CAMERAS:
                raise OptionError(
                    f"A rig's cameras are {', '.join(POLICY_CAMERAS)}; there is no {name!r}."
                )

    @staticmethod
    def simulated() -> Rig:
        """A rig without hardware: arms, grippers and cameras that are computed."""
        arm = ArmConfig(
            driver=ArmDriver.SIMULATED,
            speed_fraction=MAX_SPEED_FRACTION,
            acceleration=MAX_ACCELERATION,
        )
        gripper = GripperConfig(driver=GripperDriver.SIMULATED)
        return Rig(
            name="simulated",
            arms=dict.fromkeys(SIDES, arm),
            grippers=dict.fromkeys(SIDES, gripper),
        )

    @property
    def is_computed(self) -> bool:
        """Whether no part of it is hardware, so that its time may be computed as well."""
        return self.drivers <= {ArmDriver.SIMULATED, CameraDriver.FILE}

    @property
    def drivers(self) -> set[str]:
        """What talks to its devices."""
        devices = (*self.arms.values(), *self.grippers.values(), *self.cameras.values())
        return {str(device.driver) for device in devices}

    @staticmethod
    def read(path: Path) -> Rig:
        """Read a rig's file.

        Raises:
            FileError: It cannot be read, or is no rig.
        """
        try:
            return msgspec.json.decode(path.read_bytes(), type=Rig)
        except (OSError, msgspec.DecodeError, OptionError) as error:
            raise FileError(f"{path} cannot be read as a rig: {error}") from error

    def write(self, path: Path) -> None:
        """Write the rig's file, in place of an earlier one.

        Raises:
            OutputError: It cannot be written.
        """
        files.write(path, self._json())

    @property
    def chosen(self) -> dict[str, object]:
        """All values but those of `MEASURED`, by their places in the file: what makes it this rig.

        `hash` says more: what was measured when an episode was played.
        """

        def leaves(value: object, place: str) -> Iterator[tuple[str, object]]:
            if not isinstance(value, dict):
                yield place, value
                return
            for key, inner in value.items():
                if key not in MEASURED:
                    yield from leaves(inner, f"{place}.{key}" if place else key)

        return dict(leaves(msgspec.to_builtins(self), ""))

    @property
    def hash(self) -> str:
        """SHA-256 of everything that it says."""
        return hashlib.sha256(self._json()).hexdigest()

    def _json(self) -> bytes:
        return msgspec.json.format(msgspec.json.encode(self, order="deterministic")) + b"\n"
