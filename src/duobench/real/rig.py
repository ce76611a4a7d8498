"""A rig: two arms, grippers and cameras of one lab, as one file, `rig.json`.

Addresses, serial numbers, gains, thresholds, gripper ends and calibration change results, so the
hash of the rig stands in every episode that was played on it.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from duobench.core import files
from duobench.core.errors import (
    FileError,
    OptionError,
    UnknownNameError,
    check_known,
)
from duobench.core.settings import decode, parse
from duobench.core.types import ARM_JOINTS, SIDES, Side
from duobench.real.addresses import is_host, is_simulator
from duobench.real.catalog import (
    DRIVERS,
    FRANKY,
    HARDWARE_GRIPPER,
    check_depth,
    check_driver,
    is_computed,
)
from duobench.real.cell import LONGEST, Obstacle, Workspace
from duobench.world.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH, POLICY_CAMERAS
from duobench.world.robot.fr3_links import LINKS
from duobench.world.robot.frames import Robot, robot_with
from duobench.world.robot.gripper import DEFAULT_GRIPPER, Gripper
from duobench.world.robot.mounts import DEFAULT_MOUNT

RIG_SCHEMA = 2
"""Version of the file; raised when a field changes its meaning."""
FOLLOWER_HZ = 500.0
"""Rate at which an arm is told where to be [measured: 8 mrad behind, no reflex]."""
MAX_ACCELERATION = 6.0
"""Largest joint acceleration in rad/s² that a rig allows: at 9 arms overshot their speed limits in
a strict simulator of the robot, at 6 they did not [page real_safety; data sheet: 10]."""
MAX_SPEED_FRACTION = 0.5
"""Largest part of the joints' speed limits that a rig may allow."""
MAX_TOOL_SPEED = 2.0
"""Largest speed of a tool in m/s that a rig may allow [data sheet]."""
MAX_FORCE = 100.0
"""Largest force at the tool in N up to which a rig may let an arm push: under the 140 N that a hand
bears which is clamped [ISO/TS 15066]."""
JOINT_TORQUES = tuple(link.joint.torque for link in LINKS if link.joint is not None)
"""Largest torque of each joint in N·m; a threshold above it stops nothing [data sheet]."""
_STIFFNESS = (600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0)
_DAMPING = (50.0, 50.0, 50.0, 50.0, 30.0, 25.0, 15.0)
MOST_STIFFNESS = tuple(2.0 * stiffness for stiffness in _STIFFNESS)
"""Largest stiffness of each joint in N·m/rad: twice that with which strict simulators had no
reflex; five times, with little damping, ended in one [measured]."""
DAMPING_RATIOS = (0.5, 1.5)
"""Least and largest damping, as a part of the critical one of 1 kg·m², 2 √stiffness. The example of
the library has 0.95 to 1.06; 0.05 ended in a reflex [measured]."""
_THRESHOLDS = (20.0, 20.0, 20.0, 20.0, 8.0, 8.0, 8.0)
_LARGEST = {
    **dict.fromkeys(("speed_fraction", "home_fraction"), MAX_SPEED_FRACTION),
    "acceleration": MAX_ACCELERATION,
    "tool_speed": MAX_TOOL_SPEED,
    "force_threshold": MAX_FORCE,
    "moment_threshold": max(JOINT_TORQUES[4:]),
}
"""Numbers of an arm that are over 0, and their largest values."""
_MEASURED = re.compile(
    r"name|grippers\.\w+\.(open|closed)_count|cameras\.\w+\.calibration"
)
"""Places in the file that may change while a rig stays the same: it is called otherwise, or its
grippers' ends, lenses and mounts are measured again."""
SHORTEST_WAY = 150
"""Counts from open to closed that an empty gripper moves at least."""
SIZES, RATES = (90, 4320), (5, 120)
"""Least and most pixels of an image's side, and images a second."""
FOCAL_LENGTHS = (0.2, 20.0)
"""Least and largest focal length, in widths of the image: it shows 136 to 3 degrees."""
UNIT = 1e-3
"""Tolerance of the length of a quaternion."""
_PLACES = {"arms": "address", "grippers": "port", "cameras": "device"}
"""Parts of a rig, with the field of their devices that says where one is."""
UNPOSED = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""The pose of a camera whose lens alone is known."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ArmConfig:
    """One arm."""

    driver: str = FRANKY
    """Name of a row in `catalog.DRIVERS`, or `module:NAME`."""
    address: str = ""
    """Host name or address of its control box."""
    stiffness: tuple[float, ...] = _STIFFNESS
    """Stiffness of each joint in N·m/rad [libfranka's example of joint impedance]."""
    damping: tuple[float, ...] = _DAMPING
    """Damping of each joint in N·m·s/rad [likewise]."""
    torque_threshold: tuple[float, ...] = _THRESHOLDS
    """Torque from outside in N·m at each joint at which the arm stops with a reflex [the library's
    default, low; at the wrist what 30 N at the tool are, 0.26 m from its axes]."""
    force_threshold: float = 30.0
    """Force at the tool in N at which it does [the library's default]."""
    moment_threshold: float = 8.0
    """Moment at the tool in N·m at which it does [as the wrist's torques]."""
    speed_fraction: float = 0.25
    """Part of the joints' speed limits that it moves with at most."""
    tool_speed: float = 0.25
    """Speed of its tool in m/s at most [the reduced speed of ISO 10218-1]."""
    acceleration: float = 4.0
    """Largest acceleration of its joints in rad/s²."""
    home_fraction: float = 0.1
    """Part of the joints' speed limits with which it goes home."""
    is_realtime: bool = True
    """Whether the computer must run a realtime kernel."""

    def __post_init__(self) -> None:
        for name, most in _LARGEST.items():
            _check_positive(name, getattr(self, name), most)
        largest = {"stiffness": MOST_STIFFNESS, "torque_threshold": JOINT_TORQUES}
        for name in (*largest, "damping"):
            values = getattr(self, name)
            if len(values) != ARM_JOINTS:
                raise OptionError(
                    f"{name} is {ARM_JOINTS} numbers, one a joint; got {values}."
                )
            for number, most in enumerate(largest.get(name, ())):
                _check_positive(f"{name} of joint {number + 1}", values[number], most)
        for number, damping in enumerate(self.damping):
            critical = 2.0 * math.sqrt(self.stiffness[number])
            least, most = (ratio * critical for ratio in DAMPING_RATIOS)
            if not least <= damping <= most:
                raise OptionError(
                    f"damping of joint {number + 1} is {least:.1f} to {most:.1f} beside its "
                    f"stiffness of {self.stiffness[number]:g}, got {damping}."
                )

    @property
    def tool_thresholds(self) -> tuple[float, ...]:
        """Limits at the tool (6,): forces in N along x, y and z, then moments in N·m about them."""
        return (self.force_threshold,) * 3 + (self.moment_threshold,) * 3


@dataclass(frozen=True, kw_only=True, slots=True)
class GripperConfig:
    """One gripper."""

    driver: str = HARDWARE_GRIPPER
    """Name of a row in `catalog.DRIVERS`, or `module:NAME`."""
    port: str = ""
    """Serial port, best by its id: /dev/serial/by-id/…"""
    open_count: int = 3
    """Position, 0 to 255, that it reports when it is open and empty; measure it."""
    closed_count: int = 228
    """Position that it reports when it is closed and empty; measure it."""
    speed: int = 64
    """Speed, 0 to 255 for 20 to 150 mm/s: at first about 50."""
    force: int = 24
    """Force, 0 to 255 for 20 to 235 N: at first about 40, which holds 3 kg at a friction of 0.4."""

    def __post_init__(self) -> None:
        for name in ("open_count", "closed_count", "speed", "force"):
            if not 0 <= getattr(self, name) <= 255:  # noqa: PLR2004 - one byte
                raise OptionError(f"{name} is 0 to 255, got {getattr(self, name)}.")
        if self.closed_count - self.open_count < SHORTEST_WAY:
            raise OptionError(
                f"closed_count is larger than open_count by {SHORTEST_WAY} at least, since "
                f"positions count from open; got {self.closed_count} and {self.open_count}."
            )

    def mm_per_s(self, gripper: Gripper) -> float:
        """Speed in mm/s with which the gap of a gripper changes."""
        slowest, fastest = gripper.speeds
        return _share(self.speed, (1000.0 * slowest, 1000.0 * fastest))

    def newtons(self, gripper: Gripper) -> float:
        """Force in N of the fingers of a gripper."""
        return _share(self.force, gripper.forces)


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
            raise OptionError(
                "A pose has 7 numbers, x y z qx qy qz qw, and a distortion 5."
            )
        if not abs(math.hypot(*self.pose[3:]) - 1.0) <= UNIT:
            raise OptionError(
                f"The quaternion in pose, qx qy qz qw, has length 1; got {list(self.pose[3:])}."
            )
        if not all(abs(value) <= LONGEST for value in self.pose[:3]):
            raise OptionError(
                f"x, y and z of pose are in metres, at most {LONGEST:g}; got {list(self.pose[:3])}."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraConfig:
    """One camera."""

    driver: str
    """Name of a row in `catalog.DRIVERS`, or `module:NAME`."""
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
    depth: bool = False
    """Whether it measures depth too, as a D405 can; that is twice the data."""
    calibration: CameraCalibration | None = None
    """Lens and mount; None until they were measured."""

    def __post_init__(self) -> None:
        height, width = self.size
        if not SIZES[0] <= height < width <= SIZES[1]:
            raise OptionError(
                f"size is height and width in pixels of an image that lies across, {SIZES[0]} to "
                f"{SIZES[1]}, such as ({NATIVE_HEIGHT}, {NATIVE_WIDTH}); got {self.size}."
            )
        if not RATES[0] <= self.fps <= RATES[1]:
            raise OptionError(f"fps is {RATES[0]} to {RATES[1]}, got {self.fps}.")
        if self.exposure_us is not None:
            _check_positive("exposure_us", self.exposure_us, 1e6 / self.fps)
        if not (self.gain or 0.0) >= 0.0:
            raise OptionError(f"gain is 0 or more, got {self.gain}.")
        lens = self.calibration
        if lens is None:
            return
        if not (0.0 <= lens.cx < width and 0.0 <= lens.cy < height):
            raise OptionError(
                f"cx and cy lie in the image of {width} x {height} pixels, got {lens.cx:g} and "
                f"{lens.cy:g}."
            )
        least, most = (share * width for share in FOCAL_LENGTHS)
        if not all(least <= focal <= most for focal in (lens.fx, lens.fy)):
            raise OptionError(
                f"fx and fy are {least:g} to {most:g} pixels where images are {width} wide, got "
                f"{lens.fx:g} and {lens.fy:g}."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class Rig:
    """Everything about one lab's arms that is chosen or measured."""

    name: str
    """Name of the lab or of the robot."""
    arms: Mapping[Side, ArmConfig]
    grippers: Mapping[Side, GripperConfig]
    cameras: Mapping[str, CameraConfig] = field(default_factory=dict)
    """The cameras by name; some or all may be missing."""
    workspace: Workspace | None = field(default_factory=Workspace)
    """Box that both tools stay in; None lets them go as far as the arms reach."""
    obstacles: Mapping[str, Obstacle] = field(default_factory=dict)
    """Obstacles that the guard keeps the arms away from, by name."""
    gripper: str = DEFAULT_GRIPPER
    """Gripper on both arms, one of `GRIPPERS`, or the path "module:ATTRIBUTE" of one's own."""
    mount: str = DEFAULT_MOUNT
    """Mounting of the arms, one of `MOUNTS`."""
    schema: int = RIG_SCHEMA

    def __post_init__(self) -> None:
        _check_schema(self.schema)
        for what, devices in (("arms", self.arms), ("grippers", self.grippers)):
            if set(devices) != set(SIDES):
                raise OptionError(
                    f"A rig has {what} left and right, got {sorted(devices)}."
                )
        for name in self.cameras:
            check_known("camera of a rig", name, POLICY_CAMERAS)
        for name in (self.name, *self.obstacles):
            if not name.strip() or not name.isprintable():
                raise OptionError(
                    f"A rig and its obstacles have names in one line, got {name!r}."
                )
        for part, name, device in self.devices():
            check_driver(part, device.driver, f"{part}.{name}.driver")
            if isinstance(device, CameraConfig) and device.depth:
                check_depth(device.driver, f"{part}.{name}")
        if self.workspace is not None:
            self.workspace.check(self.robot)
        self._check_grippers()
        self._check_places()
        self.check_computed(own=False)

    @property
    def robot(self) -> Robot:
        """Description of the arms."""
        return robot_with(self.gripper, self.mount)

    def _check_grippers(self) -> None:
        """Reject a driver of another gripper than the rig has."""
        word = self.robot.gripper.word
        for side, config in self.grippers.items():
            row = DRIVERS["grippers"].get(config.driver)
            if row is not None and not row.is_computed and config.driver != word:
                raise OptionError(
                    f"grippers.{side}.driver is {word} where gripper is {self.gripper}, got "
                    f"{config.driver!r}."
                )

    def devices(
        self,
    ) -> Iterator[tuple[str, str, ArmConfig | GripperConfig | CameraConfig]]:
        """Part of the rig, name in it, and configuration of each device."""
        for part in _PLACES:
            for name, device in getattr(self, part).items():
                yield part, str(name), device

    def _check_places(self) -> None:
        """Reject hardware that is nowhere, or two devices at one place."""
        names: dict[str, str] = {}
        for part, name, device in self.devices():
            driver = DRIVERS[part].get(device.driver)
            if driver is not None and driver.is_computed:
                continue
            key = _PLACES[part]
            where = f"{part}.{name}"
            place = getattr(device, key)
            if place != place.strip() or (driver is not None and not place):
                raise OptionError(
                    f"{where}.{key} says where it is, without spaces; got {place!r}."
                )
            if driver is not None and driver.is_on_arm:
                address = self.arms[Side(name)].address
                if place != address:
                    raise OptionError(
                        f"{where}.{key} is the address of its arm, {address!r}, got {place!r}."
                    )
                continue
            if device.driver == FRANKY and not is_host(place):
                raise OptionError(
                    f"{where}.{key} is a host name or four numbers, such as 172.16.0.2; got "
                    f"{place!r}."
                )
            other = names.setdefault(place.casefold(), where) if place else where
            if other != where:
                raise OptionError(
                    f"{where}.{key} is {place!r} as for {other}; each device has its own."
                )

    def check_computed(self, *, own: bool = True) -> None:
        """Reject what is computed beside a real arm: its records would hold it as measured.

        Args:
            own: Whether drivers `module:NAME` are imported and looked at too.

        Raises:
            OptionError: A device is computed, and an arm is real.
            DuoBenchError: A driver of one's own cannot be imported.
        """
        computed: list[str] = []
        hardware: set[str] = set()
        is_real = False
        for part, name, device in self.devices():
            if not own and device.driver not in DRIVERS[part]:
                continue
            if is_computed(part, device.driver):
                computed.append(f"{part}.{name}.driver is {device.driver}")
            elif isinstance(device, ArmConfig):
                is_real = is_real or not is_simulator(device.address)
        if not (is_real and computed):
            return
        for rows in DRIVERS.values():
            hardware |= {name for name, row in rows.items() if not row.is_computed}
        raise OptionError(
            f"{computed[0]} beside a real arm: take one of {', '.join(sorted(hardware))}, or leave "
            "out a camera. Beside simulators of arms, at 127.0.0.x, the rest may be computed. "
            "A driver module:NAME of what is no hardware has `is_computed = True`."
        )

    @property
    def is_computed(self) -> bool:
        """Whether no part of it is hardware, so that its time may be computed as well.

        Drivers `module:NAME` are imported.
        """
        return all(
            is_computed(part, device.driver) for part, _, device in self.devices()
        )

    @property
    def drivers(self) -> set[str]:
        """Names of the drivers of its devices."""
        return {device.driver for _, _, device in self.devices()}

    @staticmethod
    def read(path: Path) -> Rig:
        """Read a rig's file, in which every key is known and stands once.

        Raises:
            FileError: It cannot be read, or is no rig.
        """
        with files.reading(f"a rig from {path}", FileError):
            document = parse(files.read_text(path))
            _check_schema(document.get("schema", RIG_SCHEMA))
            try:
                return decode(document, Rig)
            except UnknownNameError as error:
                raise ValueError(str(error)) from error

    def write(self, path: Path) -> None:
        """Write the rig's file, in place of an earlier one.

        Raises:
            OutputError: It cannot be written.
        """
        files.write(path, self._json())

    @property
    def chosen(self) -> dict[str, object]:
        """All values but those that are measured, by their places in the file: what makes it this.

        Its name, its grippers' ends and its cameras' calibrations may change while it stays the
        same rig; `hash` is of these too.
        """

        def leaves(value: object, place: str) -> Iterator[tuple[str, object]]:
            if _MEASURED.fullmatch(place):
                return
            if not isinstance(value, dict):
                yield place, value
                return
            for key, inner in value.items():
                yield from leaves(inner, f"{place}.{key}" if place else key)

        return dict(leaves(msgspec.to_builtins(self), ""))

    @property
    def hash(self) -> str:
        """SHA-256 of everything that it says."""
        return hashlib.sha256(self._json()).hexdigest()

    def _json(self) -> bytes:
        document = msgspec.to_builtins(self, order="deterministic")
        # Files and hashes of rigs that have the usual ones stay what they were.
        for name, usual in (("gripper", DEFAULT_GRIPPER), ("mount", DEFAULT_MOUNT)):
            if document[name] == usual:
                del document[name]
        return msgspec.json.format(msgspec.json.encode(document)) + b"\n"


def _check_positive(
    name: str,
    value: float,
    most: float,
) -> None:
    if not 0.0 < value <= most:
        raise OptionError(f"{name} is over 0 and at most {most:g}, got {value}.")


def _share(byte: int, ends: tuple[float, float]) -> float:
    return ends[0] + byte / 255.0 * (ends[1] - ends[0])


def _check_schema(schema: object) -> None:
    if schema != RIG_SCHEMA:
        raise OptionError(
            f"schema is {RIG_SCHEMA}, got {schema!r}. Since schema 2 torque_threshold is "
            f"{ARM_JOINTS} numbers and moment_threshold stands beside force_threshold: write them "
            "anew, and leave out what may have its default (see the page real_arms)."
        )
