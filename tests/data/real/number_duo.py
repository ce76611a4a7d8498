"""A rig of plain numbers: arms that are at once where they are sent, cameras that count."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np

from duobench.core.backend import Image
from duobench.core.types import SIDES, DuoCommand, Side
from duobench.data import Actor, Recorder
from duobench.data.rig import RigRecorder
from duobench.envs import DuoEnv, TaskStages, TimeLimit
from duobench.real.catalog import REHEARSAL
from duobench.real.devices import ArmReading, Frame
from duobench.real.judge import HumanJudge
from duobench.real.opening import rehearsal_rig
from duobench.real.rig import CameraConfig
from duobench.tasks import catalog
from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.envs.number_arms import NumberArms

TASK = "bin_sort"
SIZE = (32, 48)
BITS = 8
HORIZON = 40
PERIOD_S = 1 / 30


def image_of(number: int, size: tuple[int, int] = SIZE) -> Image:
    """An image that says a number in eight bars, which survive any codec."""
    bars = [255 * (number >> bit & 1) for bit in range(BITS)]
    row = np.repeat(np.array(bars, np.uint8), size[1] // BITS)
    return np.ascontiguousarray(np.broadcast_to(row[None, :, None], (size[0], len(row), 3)))


def number_in(image: Image) -> int:
    """What number an image says."""
    levels = image.mean(axis=(0, 2)).reshape(BITS, -1).mean(axis=1)
    return int(sum(1 << bit for bit in range(BITS) if levels[bit] > 127))


def numbers_in(video: Path) -> list[int]:
    with av.open(video) as container:
        return [number_in(f.to_ndarray(format="rgb24")) for f in container.decode(video=0)]


class CountingCamera:
    """Gives frame after frame when it is told to."""

    def __init__(self, size: tuple[int, int] = SIZE) -> None:
        self.frame: Frame | None = None
        self.call: Callable[[Frame], None] | None = None
        self._size = size
        self.number = -1

    def listen(self, call: Callable[[Frame], None] | None) -> None:
        self.call = call

    def take(self, time_s: float) -> None:
        self.number += 1
        image = image_of(self.number, self._size)
        self.frame = Frame(index=self.number, time_s=time_s, image=image)
        if self.call is not None:
            self.call(self.frame)


class NumberDuo(NumberArms):
    """Number arms with a clock and cameras: frames come 10 ms before the next control step."""

    def __init__(self, cameras: tuple[str, ...] = POLICY_CAMERAS) -> None:
        super().__init__()
        camera = CameraConfig(driver=REHEARSAL)
        self.rig = replace(rehearsal_rig(), cameras=dict.fromkeys(cameras, camera))
        self.robot = self.rig.robot
        self.cameras = {name: CountingCamera() for name in cameras}
        self.clock = SimpleNamespace(now=lambda: self.time)
        self.state: dict[str, Any] = {"tau_J": np.arange(7.0), "control_rate": np.array(1.0)}
        self.pass_time(1.0)

    def pass_time(self, seconds: float) -> None:
        for camera in self.cameras.values():
            camera.take(self.time + seconds - 0.01)
        self.time += seconds

    def command(self, command: DuoCommand) -> DuoCommand:
        self.pass_time(PERIOD_S)
        return super().command(command)

    def gripper_readings(self) -> Mapping[Side, SimpleNamespace]:
        openings = self.last_command.openings
        return {side: SimpleNamespace(opening=openings[side.index]) for side in SIDES}

    def see(self, cameras: Iterable[str]) -> None:
        """Images come whoever looks."""

    def frames(self) -> Mapping[str, Frame]:
        return {n: c.frame for n, c in self.cameras.items() if c.frame is not None}

    def readings(self) -> Mapping[Side, ArmReading]:
        return {
            side: ArmReading(
                time_s=self.time,
                joints=self.last_command.joints[side.index],
                velocities=np.zeros(7),
                torques=np.full(7, float(side.index)),
                is_tracking=True,
                state=self.state,
            )
            for side in SIDES
        }


def real_recorder(
    folder: Path | None, duo: NumberDuo | None = None, horizon: int = HORIZON, **options: Any
) -> tuple[Recorder, NumberDuo]:
    """An environment on number arms, whose cameras are recorded without losing a frame."""
    duo = NumberDuo() if duo is None else duo
    task = catalog.get(TASK)
    env = TimeLimit(TaskStages(DuoEnv(duo, task), HumanJudge(task.max_stage)), horizon)
    rig = RigRecorder(duo, waits=True)
    return Recorder(env, folder, Actor(name="person"), rig=rig, **options), duo


def play_real(env: Recorder, steps: int = HORIZON) -> None:
    """Move a little for some steps."""
    observation, _ = env.reset()
    for number in range(steps):
        env.step(observation["agent_pos"] + 0.01 * np.sin(number / 5))
