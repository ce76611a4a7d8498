"""Two arms of franka-sim at 127.0.0.1 and 127.0.0.2, each in a process of its own."""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import mujoco

from duobench.core.types import SIDES, Side
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from duobench.world.scene import arms as scene_arms

PYTHON = os.environ.get("DUOBENCH_FRANKA_SIM_PYTHON", ".venv-franka-sim/bin/python")
"""The interpreter of franka-sim's environment; `make test-hardware` names it."""
IS_INSTALLED = Path(PYTHON).exists()
START_S = 60.0
"""Seconds in which a simulator has to begin to serve."""
AWAY = 0.05
"""How far in radians the arms begin from home, so that going home moves them."""
_SERVER = Path(__file__).with_name("strict_server.py")


@dataclass(frozen=True, kw_only=True, slots=True)
class StrictArms:
    """Both arms, as they are served."""

    logs: dict[Side, Path]
    """What each simulator says."""

    def said(self, side: Side) -> str:
        return self.logs[side].read_text()

    def rates(self) -> dict[Side, list[float]]:
        """How many states a second each arm sent, second by second; a real one sends 1000."""
        found = {side: re.findall(r"Freq: ([\d.]+)Hz", self.said(side)) for side in SIDES}
        return {side: [float(rate) for rate in rates] for side, rates in found.items()}


def fr3(side: Side, path: Path) -> None:
    """Write one of our arms in the format of an older MuJoCo, which takes no servos of ours."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    scene_arms._add_kinematics(spec, side, ROBOT)
    spec.compile()
    root = ET.fromstring(spec.to_xml())
    for servos in root.findall("actuator"):
        root.remove(servos)
    path.write_bytes(ET.tostring(root))


@contextmanager
def _serve(side: Side, log: Path) -> Iterator[None]:
    model = log.with_suffix(".xml")
    fr3(side, model)
    joints = json.dumps((HOME_JOINTS[side.index] + AWAY).tolist())
    command = [PYTHON, "-u", str(_SERVER), f"127.0.0.{side.index + 1}", joints]
    environment = {**os.environ, "FR3_MJCF": str(model)}
    with (
        log.open("w") as out,
        subprocess.Popen(command, env=environment, stdout=out, stderr=out) as server,
    ):
        try:
            end = time.monotonic() + START_S
            while "ready for new client" not in log.read_text():
                assert server.poll() is None, log.read_text()
                assert time.monotonic() < end, log.read_text()
                time.sleep(0.1)
            yield
        finally:
            server.kill()


@contextmanager
def strict_arms(folder: Path) -> Iterator[StrictArms]:
    """Serve both arms, near home; their logs are written into a folder."""
    logs = {side: folder / f"{side}.log" for side in SIDES}
    with ExitStack() as stack:
        for side in SIDES:
            stack.enter_context(_serve(side, logs[side]))
        yield StrictArms(logs=logs)
