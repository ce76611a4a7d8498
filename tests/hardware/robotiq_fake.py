"""A Robotiq gripper on a pseudo-terminal: registers, finite speed, objects and faults."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

from tests.ptys import Cable

COMMAND, STATUS = 1000, 2000
READ_INPUT, WRITE_HOLDING = 4, 16
COUNTS_A_SECOND = 400.0
ACTIVATION_S = 1.0


class FakeGripper:
    """What the manual says that a gripper does; what happens to it may be changed at any time."""

    def __init__(
        self, now: Callable[[], float], device_id: int = 9, *, active: bool = False
    ) -> None:
        self.now = now
        self.goals: list[tuple[int, int, int]] = []
        """Every command that came: action bits, goal, speed and force."""
        self.ends = (3, 228)
        self.object_at: int | None = None
        self.fault = 0
        self.jams = False
        self._position, self._goal, self._time = float(self.ends[0]), float(self.ends[0]), now()
        self._active_at: float | None = now() - ACTIVATION_S if active else None
        self._goes = self._blocked = False
        self.cable = Cable()
        self._loop = asyncio.new_event_loop()
        self._is_ready = threading.Event()
        self._device = SimDevice(
            id=device_id,
            simdata=[
                SimData(COMMAND, values=[0, 0, 0], datatype=DataType.REGISTERS),
                SimData(STATUS, values=[0, 0, 0], datatype=DataType.REGISTERS),
            ],
            action=self._act,
        )
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._is_ready.wait(30.0)

    @property
    def port(self) -> str:
        return self.cable.ours

    @property
    def position(self) -> float:
        self._move()
        return self._position

    def lose_power(self) -> None:
        self._active_at, self._goes = None, False

    def close(self) -> None:
        asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(30.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(30.0)
        self._loop.close()
        self.cable.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())
        self._is_ready.set()
        self._loop.run_forever()

    async def _serve(self) -> None:
        self._server = ModbusSerialServer(
            self._device, port=self.cable.theirs, baudrate=115_200, ignore_missing_devices=True
        )
        await self._server.serve_forever(background=True)

    async def _act(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> None:
        self._move()
        if function == WRITE_HOLDING and values is not None:
            assert (address, count) == (COMMAND, 3)
            self._obey(*map(int, values))
        elif function == READ_INPUT:
            assert (address, count) == (STATUS, 3)
            registers[STATUS - start : STATUS - start + 3] = self._status()

    def _obey(self, bits: int, goal: int, speed_and_force: int) -> None:
        self.goals.append((bits, goal, speed_and_force))
        if not bits & 1 << 8:
            self._active_at, self.fault = None, 0
        elif self._active_at is None:
            self._active_at = self.now()
        self._goes = bool(bits & 1 << 11)
        self._goal = float(min(max(goal, self.ends[0]), self.ends[1]))

    def _state(self) -> int:
        """gSTA: 0 reset, 1 activating, 3 active."""
        if self._active_at is None:
            return 0
        return 3 if self.now() - self._active_at >= ACTIVATION_S and not self.jams else 1

    def _move(self) -> None:
        now = self.now()
        most, self._time = COUNTS_A_SECOND * (now - self._time), now
        if not (self._goes and self._state() == 3):
            return
        goal = self._goal
        if self.object_at is not None and self._position <= self.object_at < goal:
            goal = float(self.object_at)
        self._position += min(max(goal - self._position, -most), most)
        self._blocked = self._position == goal != self._goal

    def _status(self) -> list[int]:
        contact = 2 if self._blocked else 3 if self._position == self._goal else 0
        if not self._goes:
            contact = 3
        bits = (self._active_at is not None) | self._goes << 3 | self._state() << 4 | contact << 6
        return [bits << 8, self.fault << 8 | round(self._goal), round(self._position) << 8]
