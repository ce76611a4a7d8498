"""A Robotiq gripper on a pseudo-terminal: registers, finite speed, objects and faults."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

from duobench.real.registers import GripperRegisters
from tests.ptys import Cable

COMMAND, STATUS = 1000, 2000
READ_INPUT, WRITE_HOLDING = 4, 16
COUNTS_A_SECOND = 400.0


class FakeGripper:
    """What the manual says that a gripper does; what happens to it may be changed at any time."""

    def __init__(
        self, now: Callable[[], float], device_id: int = 9, *, active: bool = False
    ) -> None:
        self.now = now
        self.goals: list[tuple[int, int, int]] = []
        """Every command that came: action bits, goal, speed and force."""
        self.registers = GripperRegisters(is_active=active)
        self.object_at: int | None = None
        self._time = now()
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
        return self.registers.position

    def lose_power(self) -> None:
        """Lose the power for a moment."""
        self.registers.lose_power()
        self.registers.has_power = True

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
            action, goal, speed_and_force = map(int, values)
            self.goals.append((action, goal, speed_and_force))
            self.registers.write((action, goal, speed_and_force))
        elif function == READ_INPUT:
            assert (address, count) == (STATUS, 3)
            registers[STATUS - start : STATUS - start + 3] = self.registers.read()

    def _move(self) -> None:
        now, position, goal = self.now(), self.registers.position, self.registers.target
        most, self._time = COUNTS_A_SECOND * (now - self._time), now
        if goal is not None:
            if self.object_at is not None and position <= self.object_at < goal:
                goal = float(self.object_at)
            position += min(max(goal - position, -most), most)
        self.registers.move(position, now)
