"""A Robotiq 2F-85 on a serial port, by Modbus RTU.

A goal is written when it changes and never again: goals that are sent over and over keep some
grippers from moving. Registers and codes are those of the manufacturer's instruction manual. Tried
against an imitated gripper on a pseudo-terminal, and on no hardware.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from duobench.core.errors import ActionError, BackendError
from duobench.core.machine import load_extra
from duobench.core.types import Side
from duobench.real.clock import Clock, Ticker
from duobench.real.devices import GripperReading
from duobench.real.registers import (
    ACTIVATE,
    ACTIVE,
    AT_GOAL,
    GO,
    MOVING,
    GripperRegisters,
)
from duobench.real.rig import SHORTEST_WAY, GripperConfig
from duobench.results.labels import Fault, FaultKind

if TYPE_CHECKING:
    from duobench.real.rehearsal import RehearsalWorld

DEVICE_ID = 9
"""The gripper's address on its bus, as it is sold."""
BAUD = 115_200
COMMAND, STATUS, REGISTERS = 1000, 2000, 3
"""First register of the command and of the status, and how many each has."""
READ_HZ = 30.0
SILENT_S = 0.2
"""Age of the last answer at which silence is a fault."""
ANSWER_S = 0.05
"""Seconds in which an answer has to come."""
REOPEN_S = 1.0
"""Seconds between two tries to open a port that has gone."""
ACTIVATION_S = 15.0
"""Seconds in which an activation has to end."""
REST_S = 0.7
"""Seconds without movement after which it is at an end."""
TRIES = 3
"""Attempts to find a gripper."""
_FAULTS = {
    0x08: "it is too hot and has to cool down",
    0x0A: "its supply voltage is too low",
    0x0B: "it is releasing what it held by itself",
    0x0C: "it has an internal fault",
    0x0D: "its activation failed; look for something between the fingers",
    0x0E: "its motor drew too much current",
    0x0F: "it has released what it held by itself",
}
"""Meanings of faults. The codes 5, 7 and 9 only note that it was not activated, or not asked for a
while."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Status:
    """Contents of the three status registers."""

    is_activated: bool
    """gACT and gSTA: it was activated, and that has ended."""
    contact: int
    """gOBJ: 0 moving, 1 stopped at something while opening, 2 while closing, 3 at its goal."""
    fault: int
    """Fault code gFLT; 0 without a fault."""
    position: int
    """Counts, 0 open to 255 closed."""

    @staticmethod
    def of(registers: Sequence[int]) -> Status:
        """Read three registers of 16 bits, high bytes first."""
        first, second, third = registers
        bits = first >> 8
        return Status(
            is_activated=bool(bits & 1) and (bits >> 4) & 3 == ACTIVE,
            contact=(bits >> 6) & 3,
            fault=(second >> 8) & 0x0F,
            position=third >> 8,
        )


class RegisterPort(Protocol):
    """Connection to a gripper's registers."""

    trouble: str
    """Last error, in words."""

    @property
    def is_open(self) -> bool:
        """Whether it leads anywhere."""
        ...

    def open(self) -> bool:
        """Try to open the port; return whether it is open."""
        ...

    def write(self, values: Sequence[int]) -> bool:
        """Write the registers of the command; return whether the gripper acknowledged them."""
        ...

    def read(self) -> list[int] | None:
        """Read the registers of the status; None if the gripper does not respond."""
        ...

    def close(self) -> None:
        """Close the port; closing twice is harmless."""


class SerialPort:
    """Modbus RTU on a serial port; an answer has to come in `answer_s` seconds."""

    def __init__(self, name: str, answer_s: float) -> None:
        modbus, clients, _ = (  # pymodbus looks whether serial was loaded
            load_extra(
                each, "hardware", "Grippers need pymodbus and pyserial", BackendError
            )
            for each in ("pymodbus", "pymodbus.client", "serial")
        )
        # What goes wrong is part of a reading; without this each lost answer would be printed.
        logging.getLogger("pymodbus").addHandler(logging.NullHandler())
        self._errors = (OSError, modbus.ModbusException)
        client = clients.ModbusSerialClient
        self.client: Any = client(
            name,
            baudrate=BAUD,
            timeout=answer_s,
            retries=0,
        )
        self.trouble = ""

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return bool(self.client.connected)

    def open(self) -> bool:
        """Open it, with quick answers where the adapter knows how."""
        if not self.client.connect():
            return False
        # Without this mode, which not every port has, an adapter waits 16 ms for each answer.
        with suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self.client.socket.set_low_latency_mode(True)
        return True

    def write(self, values: Sequence[int]) -> bool:
        """Write the registers of the command."""
        write = self.client.write_registers
        return self._answer(write, COMMAND, list(values)) is not None

    def read(self) -> list[int] | None:
        """Read the registers of the status."""
        answer = self._answer(self.client.read_input_registers, STATUS, count=REGISTERS)
        if answer is None or len(answer.registers) == REGISTERS:
            return answer and answer.registers
        self.trouble = f"it answered {answer}"
        return None

    def close(self) -> None:
        """Close the port."""
        self.client.close()

    def _answer(
        self,
        ask: Callable[..., Any],
        *what: Any,
        **more: Any,
    ) -> Any:
        try:
            answer = ask(*what, **more, device_id=DEVICE_ID)
        except self._errors as error:
            self.trouble = str(error)
            return None
        if answer.isError():
            self.trouble = f"it answered {answer}"
            return None
        return answer


class RehearsalPort:
    """Leads to the registers of a gripper of the world, in place of a serial line."""

    trouble = ""

    def __init__(self, world: RehearsalWorld, side: Side) -> None:
        self._world, self._registers = world, world.grippers[side]

    @property
    def is_open(self) -> bool:
        """Always: its cable cannot be pulled."""
        return True

    def open(self) -> bool:
        """Advance the world's time."""
        self._world.enter(self)
        return True

    def write(self, values: Sequence[int]) -> bool:
        """Write the registers of the command, if the gripper has power."""
        with self._world.lock:
            if self._has_answer():
                self._registers.write(values)
        return self._registers.has_power

    def read(self) -> list[int] | None:
        """Read the registers of the status, if the gripper has power."""
        with self._world.lock:
            return self._registers.read() if self._has_answer() else None

    def close(self) -> None:
        """Let go of the world."""
        self._world.leave(self)

    def _has_answer(self) -> bool:
        self.trouble = "" if self._registers.has_power else "it has no power"
        return self._registers.has_power


class RobotiqGripper:
    """A gripper that a ticker of the clock asks 30 times a second, and tells what is new.

    It is reached over a port, by default the serial one that its configuration names, where an
    answer has to come in `answer_s` seconds.
    """

    imitation = GripperRegisters
    """Stands for the hardware in a rehearsal."""

    def __init__(
        self,
        config: GripperConfig,
        clock: Clock,
        *,
        answer_s: float = ANSWER_S,
        port: RegisterPort | None = None,
    ) -> None:
        self._config = config
        self._clock = clock
        self._answer_s = answer_s
        self._port = port
        self._ticker: Ticker | None = None
        self._lock = threading.Lock()  # over what other threads want
        self._goal: int | None = None
        self._is_holding = False
        self._activation: list[int] = []
        self._told: tuple[int, int] | None = None
        self._newest: tuple[float, Status] | None = None
        self._was_active = False
        self._next_open = 0.0
        self.round_trips: deque[float] = deque(maxlen=300)
        """Seconds that the latest answers took."""

    def connect(self) -> None:
        """Open the port and ask the gripper; nothing moves."""
        if self._ticker is not None:
            return
        name = self._config.port
        self._port = self._port or SerialPort(name, self._answer_s)
        if not self._open():
            raise BackendError(
                f"The port {name!r} of a gripper cannot be opened: {_why(name)} Its name is best "
                "one of /dev/serial/by-id/."
            )
        if not any(self._ask() for _ in range(TRIES)):
            self._port.close()
            raise BackendError(
                f"No gripper answers at {name} as device {DEVICE_ID} with {BAUD} bits a second; "
                f"look at its 24 V supply and at what else hangs on the port ({self._trouble})."
            )
        self._ticker = self._clock.every(1.0 / READ_HZ, self._tick, f"gripper {name}")

    def activate(self) -> None:
        """Move the fingers through their whole range, unless it is active and well already.

        Only with a person's consent: anything between the fingers is squeezed.
        """
        reading = self.read()
        if reading.is_active and reading.fault is None:
            return
        with self._lock:
            self._goal, self._is_holding = None, False
            self._activation = [0, ACTIVATE]  # a fault is forgotten only by the zero
        end = self._clock.now() + ACTIVATION_S
        while self._clock.now() < end:
            self._clock.wait_until(self._clock.now() + 1.0 / READ_HZ)
            reading = self.read()
            if self._is_holding:
                raise BackendError(
                    f"The activation of the gripper at {self._config.port} was stopped."
                )
            if self._clock.now() - reading.time_s > SILENT_S:
                break
            if not self._activation and reading.is_active and reading.fault is None:
                return
        why = (
            reading.fault.text if reading.fault else f"it took over {ACTIVATION_S:g} s."
        )
        raise BackendError(
            f"The gripper at {self._config.port} was not activated: {why}"
        )

    def read(self) -> GripperReading:
        """The latest reading; its fault says what is wrong now, silence included."""
        if self._newest is None:
            raise BackendError("A gripper is read after it was connected.")
        time_s, status = self._newest
        low, high = self._config.open_count, self._config.closed_count
        return GripperReading(
            time_s=time_s,
            opening=min(max((high - status.position) / (high - low), 0.0), 1.0),
            is_active=status.is_activated,
            has_object=status.is_activated and status.contact not in {MOVING, AT_GOAL},
            fault=self._fault(time_s, status),
        )

    @property
    def position(self) -> int | None:
        """Position that it reported last, 0 open to 255 closed; None before the first answer."""
        return None if self._newest is None else self._newest[1].position

    def command(self, opening: float) -> None:
        """Go to an opening, 0 closed to 1 open; beyond them is the nearer end. Returns at once."""
        if not math.isfinite(opening):
            raise ActionError(f"An opening is a number from 0 to 1, got {opening}.")
        low, high = self._config.open_count, self._config.closed_count
        goal = round(high - min(max(opening, 0.0), 1.0) * (high - low))
        with self._lock:
            if self._activation:
                return
            self._goal, self._is_holding = goal, False

    def hold(self) -> None:
        """Stop the fingers if they move; a grip keeps its force, an activation ends unfinished."""
        with self._lock:
            self._is_holding = True
            if self._activation:
                self._activation = [0]

    def recover(self) -> None:
        """Forget that it was active: it lost its power, and has to be activated again."""
        self._was_active = False

    def close(self) -> None:
        """Close the port; the gripper keeps what it holds. Closing twice is harmless."""
        if self._ticker is not None:
            self._ticker.stop()
            self._ticker = None
        if self._port is not None:
            self._port.close()

    @classmethod
    def rehearse(
        cls,
        config: GripperConfig,
        clock: Clock,
        world: RehearsalWorld,
        side: Side,
    ) -> RobotiqGripper:
        """The gripper of a side of a rehearsal."""
        return cls(config, clock, port=RehearsalPort(world, side))

    @classmethod
    def measure_ends(
        cls, config: GripperConfig, clock: Clock, *, answer_s: float = ANSWER_S
    ) -> GripperConfig:
        """Open and close an empty gripper, and give it with the ends where it stops.

        Only on a person's word; the ends that it has are not looked at.
        """
        whole = replace(config, open_count=0, closed_count=255)
        gripper = cls(whole, clock, answer_s=answer_s)
        try:
            gripper.connect()
            gripper.activate()
            closed, opened = (_end(gripper, clock, opening) for opening in (0.0, 1.0))
        finally:
            gripper.close()
        if closed - opened < SHORTEST_WAY:
            raise BackendError(
                f"The gripper moved from {opened} to {closed} counts only; at least "
                f"{SHORTEST_WAY} are usual. Take away what is between its fingers."
            )
        return replace(config, open_count=opened, closed_count=closed)

    @property
    def _trouble(self) -> str:
        return self._port.trouble if self._port else ""

    def _fault(self, time_s: float, status: Status) -> Fault | None:
        port = self._config.port
        silence = self._clock.now() - time_s
        if silence > SILENT_S:
            text = f"The gripper at {port} has not answered for {silence:.1f} s ({self._trouble})."
            return FaultKind.COMMUNICATION.fault(text)
        meaning = _FAULTS.get(status.fault)
        if meaning is not None:
            text = (
                f"The gripper at {port} reports fault 0x{status.fault:02X}: {meaning}."
            )
            return FaultKind.COMMUNICATION.fault(text)
        if self._was_active and not status.is_activated and not self._activation:
            text = f"The gripper at {port} is active no more; it lost its power, or was reset."
            return FaultKind.COMMUNICATION.fault(text)
        return None

    def _tick(self) -> None:
        port = self._port
        assert port is not None  # it ticks once it is connected
        if not port.is_open and (
            self._clock.now() < self._next_open or not self._open()
        ):
            return
        news = self._news()
        if news is not None:
            start = time.perf_counter()
            if port.write([*news, self._config.speed << 8 | self._config.force]):
                self.round_trips.append(time.perf_counter() - start)
                self._told = news
                with self._lock:
                    if self._activation and self._activation[0] == news[0]:
                        self._activation.pop(0)
                        self._was_active, self._told = False, None
        self._ask()

    def _news(self) -> tuple[int, int] | None:
        """Action bits and goal that were not told yet."""
        with self._lock:
            if self._activation:
                return self._activation[0], 0
            goal, is_holding = self._goal, self._is_holding
        status = self._newest[1] if self._newest else None
        if goal is None or status is None or not status.is_activated:
            return None
        if is_holding and (self._told is None or status.contact != MOVING):
            return None  # it rests already: at its goal, or with a grip
        news = (ACTIVATE, goal) if is_holding else (ACTIVATE | GO, goal)
        return news if news != self._told else None

    def _ask(self) -> bool:
        start = time.perf_counter()
        if self._port is None or (registers := self._port.read()) is None:
            return False
        self.round_trips.append(time.perf_counter() - start)
        status = Status.of(registers)
        self._newest = self._clock.now(), status
        self._was_active |= status.is_activated
        return True

    def _open(self) -> bool:
        self._next_open = self._clock.now() + REOPEN_S
        return self._port is not None and self._port.open()


def _end(
    gripper: RobotiqGripper,
    clock: Clock,
    opening: float,
) -> int:
    gripper.command(opening)
    end = clock.now() + ACTIVATION_S
    last = gripper.position
    since = clock.now()
    while clock.now() < end:
        clock.wait_until(clock.now() + 1.0 / READ_HZ)
        fault = gripper.read().fault
        if fault is not None:
            raise BackendError(fault.text)
        if gripper.position != last:
            last, since = gripper.position, clock.now()
        if clock.now() - since > REST_S and last is not None:
            return last
    raise BackendError("The gripper does not come to rest.")


def _why(port: str) -> str:
    """Reason why a port cannot be opened, in a sentence."""
    try:
        with open(port, "r+b", buffering=0):  # noqa: PTH123 - a device
            return "another program uses it."
    except OSError as error:
        return f"{error.strerror}."
