"""What is known about a pair of GELLO arms: ports, servos, and where their zeros are."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

import msgspec

from duobench.errors import LeaderError, check_known
from duobench.types import ARM_JOINTS, SIDES

BAUD = 57_600
"""Bits a second, as the servos are delivered."""
_MOST_ID = 252
"""Largest id of a servo [DYNAMIXEL protocol 2.0]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class GelloArm:
    """One leader arm: seven servos, and one at the gripper's trigger.

    A joint is `sign * (servo - offset)`, in radians, and brought within half a turn of the middle
    of the robot's range.
    """

    port: str
    """Serial port, best by its id: /dev/serial/by-id/usb-FTDI_..."""
    offsets: tuple[float, ...]
    """What each servo (7) shows where the robot's joint is at zero, in radians."""
    signs: tuple[int, ...]
    """1 where a servo (7) turns as the robot's joint does, -1 where it turns against it."""
    gripper_open: float
    """What the servo of the trigger shows when it is released, in radians."""
    gripper_closed: float
    """What it shows when it is pulled."""
    ids: tuple[int, ...] = tuple(range(1, ARM_JOINTS + 1))
    """Ids of the servos (7), from the base on."""
    gripper_id: int = ARM_JOINTS + 1
    """Id of the trigger's servo."""

    def __post_init__(self) -> None:
        """Reject numbers that cannot be those of an arm."""
        for name in ("offsets", "signs", "ids"):
            if len(getattr(self, name)) != ARM_JOINTS:
                raise LeaderError(
                    f"{name} are {ARM_JOINTS} numbers, one a joint; got {getattr(self, name)}."
                )
        if any(sign not in {-1, 1} for sign in self.signs):
            raise LeaderError(f"signs are 1 or -1, got {self.signs}.")
        ids = (*self.ids, self.gripper_id)
        if len(set(ids)) != len(ids) or not all(0 <= each <= _MOST_ID for each in ids):
            raise LeaderError(f"Servos have different ids from 0 to {_MOST_ID}, got {ids}.")
        numbers = (*self.offsets, self.gripper_open, self.gripper_closed)
        if not all(map(math.isfinite, numbers)) or self.gripper_open == self.gripper_closed:
            raise LeaderError(
                "Offsets and the two ends of a gripper are finite, and the ends differ; got "
                f"{self.offsets}, {self.gripper_open}, {self.gripper_closed}."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class GelloConfig:
    """A pair of leader arms."""

    left: GelloArm
    """The arm that leads the robot's left one."""
    right: GelloArm
    """The arm that leads the robot's right one."""
    baud: int = BAUD
    """Bits a second on both ports."""

    def __post_init__(self) -> None:
        """Reject two arms at one port."""
        if self.left.port == self.right.port:
            raise LeaderError(f"Each arm has a port of its own, got {self.left.port} for both.")

    @staticmethod
    def read(path: Path) -> GelloConfig:
        """Read a TOML file: `[left]` and `[right]` with the fields of `GelloArm`, and `baud`.

        Raises:
            LeaderError: It cannot be read, or lacks something.
            UnknownNameError: It has a key that means nothing.
        """
        try:
            document = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise LeaderError(f"Cannot read {path}: {error}") from error
        for name in document:
            check_known("key of a GELLO file", name, _names(GelloConfig))
        for side in SIDES:
            for name in document.get(side, {}) if isinstance(document.get(side), dict) else ():
                check_known(f"key of the {side} GELLO arm", name, _names(GelloArm))
        try:
            return msgspec.convert(document, GelloConfig)
        except msgspec.ValidationError as error:
            raise LeaderError(f"{path} is invalid: {error}.".replace("`$.", "`")) from error


def _names(kind: type[GelloArm] | type[GelloConfig]) -> list[str]:
    return [each.name for each in fields(kind)]
