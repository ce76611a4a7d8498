"""GELLO arms as leaders: DYNAMIXEL servos, read over two serial ports.

Tried against servos that were imitated on a pseudo-terminal, and on no hardware.
"""

import math
import threading
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from duobench.core.errors import LeaderError
from duobench.core.files import read_text, reading
from duobench.core.machine import load_extra
from duobench.core.settings import decode
from duobench.core.types import (
    ARM_JOINTS,
    SIDES,
    Array,
    DuoCommand,
)
from duobench.teleop.hands import MAX_AGE_S
from duobench.world.robot.joints import JOINT_RANGES

BAUD = 57_600
"""Bits a second, as the servos are delivered."""
_MOST_ID = 252
"""Largest id of a servo [DYNAMIXEL protocol 2.0]."""
PROTOCOL = 2.0
PRESENT_POSITION, POSITION_BYTES = 132, 4
"""Address and length of the position of a servo of the X series [DYNAMIXEL X control table]."""
COUNTS_A_TURN = 4096
STATUS_BYTES = 11 + POSITION_BYTES
"""Length of a servo's answer [DYNAMIXEL protocol 2.0]."""
ANSWER_S = 0.1
"""Seconds after which servos that have not answered are asked again."""
PINGS = 10
"""Attempts to reach a servo, of 34 ms each, before it is given up."""
POLL_S = 0.001
"""Seconds between two looks at what has arrived."""
_MIDDLES = np.mean(JOINT_RANGES, axis=1)


@dataclass(frozen=True, kw_only=True, slots=True)
class GelloArm:
    """One leader arm: seven servos, and one at the gripper's trigger.

    A joint is `sign * (servo - offset)`, in radians, and brought within half a turn of the middle
    of the robot's range.
    """

    port: str
    """Serial port, best by its id: /dev/serial/by-id/usb-FTDI_..."""
    offsets: tuple[float, ...]
    """Reading of each servo (7) where the robot's joint is at zero, in radians."""
    signs: tuple[int, ...]
    """1 where a servo (7) turns as the robot's joint does, -1 where it turns against it."""
    gripper_open: float
    """Reading of the trigger's servo when it is released, in radians."""
    gripper_closed: float
    """Reading of the trigger's servo when it is pulled, in radians."""
    ids: tuple[int, ...] = tuple(range(1, ARM_JOINTS + 1))
    """Ids of the servos (7), from the base on."""
    gripper_id: int = ARM_JOINTS + 1
    """Id of the trigger's servo."""

    def __post_init__(self) -> None:
        for name in ("offsets", "signs", "ids"):
            if len(getattr(self, name)) != ARM_JOINTS:
                raise LeaderError(
                    f"{name} are {ARM_JOINTS} numbers, one a joint; got {getattr(self, name)}."
                )
        if any(sign not in {-1, 1} for sign in self.signs):
            raise LeaderError(f"signs are 1 or -1, got {self.signs}.")
        ids = (*self.ids, self.gripper_id)
        if len(set(ids)) != len(ids) or not all(0 <= each <= _MOST_ID for each in ids):
            raise LeaderError(
                f"Servos have different ids from 0 to {_MOST_ID}, got {ids}."
            )
        numbers = (*self.offsets, self.gripper_open, self.gripper_closed)
        if (
            not all(map(math.isfinite, numbers))
            or self.gripper_open == self.gripper_closed
        ):
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
    baud: int = BAUD
    """Bits a second on both ports."""

    def __post_init__(self) -> None:
        if self.left.port == self.right.port:
            raise LeaderError(
                f"Each arm has a port of its own, got {self.left.port} for both."
            )

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a TOML file: `[left]` and `[right]` with the fields of `GelloArm`, and `baud`."""
        with reading(path, LeaderError):
            return decode(tomllib.loads(read_text(path)), cls)


class _Bus:
    """The servos of one arm, which a thread of its own asks again and again."""

    def __init__(self, arm: GelloArm, baud: int) -> None:
        import dynamixel_sdk as sdk  # pyright: ignore[reportMissingImports]

        self._arm, self._success = arm, sdk.COMM_SUCCESS
        self._port: Any = sdk.PortHandler(arm.port)
        packets = sdk.PacketHandler(PROTOCOL)
        try:
            is_open = self._port.setBaudRate(baud)
        except OSError as error:
            raise LeaderError(f"Cannot open {arm.port}: {error}") from error
        if not is_open:
            raise LeaderError(
                f"{arm.port} knows no {baud} bits a second; 57600 is usual."
            )
        self._ids = (*arm.ids, arm.gripper_id)
        self._query = sdk.GroupSyncRead(
            self._port, packets, PRESENT_POSITION, POSITION_BYTES
        )
        for each in self._ids:
            pings = (packets.ping(self._port, each)[1] for _ in range(PINGS))
            if sdk.COMM_SUCCESS not in pings:
                self._port.closePort()
                raise LeaderError(
                    f"Servo {each} at {arm.port} does not answer; look at its power, its id and "
                    f"the {baud} bits a second."
                )
            self._query.addParam(each)
        self._newest: tuple[float, Array] | None = None
        self._is_closing = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"gello {arm.port}", daemon=True
        )
        self._thread.start()

    def read(self) -> Array | None:
        newest = self._newest
        if newest is None or time.monotonic() - newest[0] > MAX_AGE_S:
            return None
        return newest[1]

    def close(self) -> None:
        self._is_closing.set()
        self._thread.join()
        self._port.closePort()

    def _run(self) -> None:
        while not self._is_closing.is_set():
            try:
                counts = self._ask()
                if counts is not None:
                    self._newest = time.monotonic(), joints_of(self._arm, counts)
            except OSError:  # the cable was pulled: what was read last grows old
                return

    def _ask(self) -> list[int] | None:
        """Read the servos (8,), in counts; None where one did not answer well."""
        if self._query.txPacket() != self._success:
            return None
        end = time.monotonic() + ANSWER_S
        # The library would look without a pause, and keep all other threads from running.
        while self._port.getBytesAvailable() < STATUS_BYTES * len(self._ids):
            if time.monotonic() > end or self._is_closing.is_set():
                break
            time.sleep(POLL_S)
        if self._query.rxPacket() != self._success:
            return None
        return [
            self._query.getData(each, PRESENT_POSITION, POSITION_BYTES)
            for each in self._ids
        ]


class GelloSource:
    """Two GELLO arms; Franka's GELLO Duo is such a pair. No port is opened before `connect`."""

    device = "gello"

    def __init__(self, config: GelloConfig) -> None:
        self._config = config
        self._buses: list[_Bus] = []

    def connect(self) -> None:
        """Open both ports, and begin to read."""
        load_extra(
            "dynamixel_sdk", "teleop", "GELLO arms need dynamixel-sdk", LeaderError
        )
        try:
            for arm in (self._config.left, self._config.right)[len(self._buses) :]:
                self._buses.append(_Bus(arm, self._config.baud))
        except LeaderError:
            self.close()
            raise

    def read(self) -> Array | None:
        """Read the leaders (16,); None where one of them has not answered for too long."""
        rows = [bus.read() for bus in self._buses]
        if len(rows) < len(SIDES) or any(row is None for row in rows):
            return None
        both = np.array(rows)
        return DuoCommand(joints=both[:, :-1], openings=both[:, -1]).flat

    def close(self) -> None:
        """Stop reading and close the ports; closing twice is harmless."""
        for bus in self._buses:
            bus.close()
        self._buses.clear()


def joints_of(arm: GelloArm, counts: list[int]) -> Array:
    """Joints in radians and the opening, 0 to 1, (8,) of what the servos show.

    The counts (8,) are numbers of 32 bits, with or without a sign; the trigger's comes last.
    """
    signed = [(count + 2**31) % 2**32 - 2**31 for count in counts]
    *servos, trigger = (count * 2.0 * math.pi / COUNTS_A_TURN for count in signed)
    joints = np.array(arm.signs) * (np.array(servos) - np.array(arm.offsets))
    turns = np.rint((joints - _MIDDLES) / (2.0 * math.pi))
    opening = (trigger - arm.gripper_closed) / (arm.gripper_open - arm.gripper_closed)
    return np.append(joints - 2.0 * math.pi * turns, min(max(opening, 0.0), 1.0))
