"""Record a rig's three cameras in real time, kill the process, and count what is lost.

    python -m dev.benchmarks.real_recording --seconds 60

The arms are the simulated drivers, the cameras give generated frames of 1280x720 at 30 Hz with
noise in them. Where a rig would hold its arms, because the machine is too busy to lead them, this
one goes on. Printed are the seconds that the kill cost, frames that were left out because the
encoder was too far behind, frames that the cameras lost, and how regular the control steps were.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from duobench.core.backend import Image
from duobench.core.types import CONTROL_HZ, POLICY_CAMERAS, SIDES
from duobench.data import Actor, DataSet, Recorder, Recording
from duobench.data.rig import RigRecorder
from duobench.real.clock import SystemClock
from duobench.real.drivers.simulated import SimulatedArm, SimulatedCamera, SimulatedGripper
from duobench.real.duo import FrankaDuo
from duobench.real.env import make_real_env
from duobench.real.rig import Rig
from duobench.world.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from duobench.world.robot.joints import HOME_JOINTS

ROOT = Path(__file__).parents[2]
TASK = "bin_sort"
DIFFERENT = 15
"""Frames that a camera shows in turn."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Killed:
    """What was left of a recording whose process was killed."""

    steps: int
    """Control steps that had been made."""
    recording: Recording
    """What was recovered."""
    last_s: float
    """When the last control step had been made, on the rig's clock."""

    @property
    def lost_s(self) -> float:
        """Seconds of rows that are missing at the end."""
        return self.last_s - float(self.recording.time[-1])

    @property
    def lost_images_s(self) -> float:
        """Seconds of images that are missing at the end, of the camera that lost most."""
        taken = self.recording.time[-1] - self.recording.frame_age[-1]
        return self.last_s - float(taken.min())

    @property
    def lost_frames(self) -> int:
        """Frames without a place in a video: of an encoder that was behind, or of a camera."""
        gaps = np.diff(self.recording.frame_number[:, :], axis=0).sum(axis=0)
        places = np.diff(self.recording.frame[:, :], axis=0).sum(axis=0)
        return int((gaps - places).sum())

    @property
    def period_ms(self) -> tuple[float, float]:
        """Median and 99 % quantile of the time from one control step to the next."""
        periods = 1000.0 * np.diff(self.recording.time[1:])
        return float(np.median(periods)), float(np.quantile(periods, 0.99))


class Tolerant(FrankaDuo):
    """A rig that holds for nothing, so that a busy machine is measured to the end."""

    def _check(self) -> None:
        """Find nothing wrong."""

    def image_ages(self) -> dict[str, float]:
        """No image is too old."""
        return {}


def pictures(seed: int) -> Callable[[int, float], Image]:
    """What a camera shows: a scene that moves, with the noise of a sensor."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:NATIVE_HEIGHT, :NATIVE_WIDTH]
    scene = np.stack([x // 6, y // 4, 60 * (x // 160 % 2) + 60 * (y // 160 % 2)], axis=-1)
    noise = rng.integers(0, 8, (DIFFERENT, *scene.shape), dtype=np.uint8)
    shown = [np.roll(scene, 4 * n, axis=1).astype(np.uint8) + noise[n] for n in range(DIFFERENT)]
    return lambda number, _time_s: shown[number % DIFFERENT]


def make(folder: Path) -> Recorder:
    """An environment of simulated drivers in real time, which records."""
    clock, rig = SystemClock(), Rig.simulated()
    duo = Tolerant(
        rig,
        clock,
        arms={side: SimulatedArm(clock, HOME_JOINTS[side.index]) for side in SIDES},
        grippers={side: SimulatedGripper(clock) for side in SIDES},
        cameras={
            name: SimulatedCamera(clock, source=pictures(seed))
            for seed, name in enumerate(POLICY_CAMERAS)
        },
    )
    env = make_real_env(duo, TASK, cameras=(), horizon=1_000_000)
    duo.supervisor.confirm()
    return Recorder(env, folder, Actor(name="sine"), rig=RigRecorder(duo))


def record(folder: Path) -> None:
    """Record until somebody kills this process; every control step is printed with its time."""
    env = make(folder)
    observation, _ = env.reset()
    home = observation["agent_pos"].astype(float)
    for step in range(1_000_000):
        *_, info = env.step(home + 0.05 * np.sin(step / 40))
        if reason := info.get("truncation_reason"):
            print(f"ended: {reason}", flush=True)
            return
        print(env.base.backend.time, flush=True)


def kill_after(steps: int, folder: Path) -> Killed:
    """Record in a process of its own, kill it after so many control steps, and recover.

    Raises:
        AssertionError: The recording ended by itself.
    """
    paths = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    process = subprocess.Popen(
        [sys.executable, "-m", "dev.benchmarks.real_recording", "--record", str(folder)],
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        text=True,
    )
    with process as child:
        if child.stdout is None:
            raise AssertionError("The output of the process is read.")
        lines = []
        for line in child.stdout:
            lines.append(line)
            if line.startswith("ended"):
                raise AssertionError(line)
            if len(lines) == steps:
                child.send_signal(signal.SIGKILL)
    times = [float(line) for line in lines if line.endswith("\n")]
    data = DataSet.open(folder, create=False)
    (partial,) = data.partials()
    recording = Recording.read(data.recover(partial))
    return Killed(steps=len(times), recording=recording, last_s=times[-1])


def main(seconds: float) -> None:
    """Measure, and print."""
    with tempfile.TemporaryDirectory() as name:
        found = kill_after(round(seconds * CONTROL_HZ), Path(name))
        megabytes = sum(path.stat().st_size for path in DataSet(Path(name)).videos()) / 1e6
    middle, most = found.period_ms
    print(
        f"{len(found.recording)} of {found.steps} control steps recovered; "
        f"lost by the kill: {found.lost_s:.2f} s of rows, {found.lost_images_s:.2f} s of images; "
        f"frames left out: {found.lost_frames}; "
        f"a control step every {middle:.1f} ms (99 %: {most:.1f}); videos: {megabytes:.0f} MB; "
        f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--record", type=Path)
    asked = parser.parse_args()
    if asked.record is None:
        main(asked.seconds)
    else:
        record(asked.record)
