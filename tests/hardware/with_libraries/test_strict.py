"""An arm by franky against franka-sim, which enforces the arm's limits and trips reflexes.

It has an environment of its own; `make test-hardware` names its Python. DUOBENCH_TARGETS is the
number of random targets, thirty a second: 10000 takes six minutes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import mujoco
import pytest

from duobench.scene.robot import arms as scene_arms
from duobench.types import Side

pytest.importorskip("franky", reason="franky-control is not installed; see `make test-hardware`")
PYTHON = os.environ.get("DUOBENCH_FRANKA_SIM_PYTHON", ".venv-franka-sim/bin/python")
TARGETS = int(os.environ.get("DUOBENCH_TARGETS", "600"))
pytestmark = pytest.mark.skipif(
    not Path(PYTHON).exists(), reason="franka-sim is not installed; see `make test-hardware`"
)
SERVER = """
import os, sys
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
except PermissionError:
    pass
sys.argv[1:] = ["--physics", "mujoco", "--no-gripper", "--enforce-comm-constraints",
                "--enforce-motion-limits"]
from franka_sim.run_server import main
main()
"""


def fr3(path: Path) -> None:
    """Write our arm alone in the format of an older MuJoCo, which takes no servos of ours."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    scene_arms._add_kinematics(spec, Side.LEFT)
    spec.compile()
    root = ET.fromstring(spec.to_xml())
    for servos in root.findall("actuator"):
        root.remove(servos)
    path.write_bytes(ET.tostring(root))


@pytest.fixture
def strict(tmp_path: Path) -> Iterator[None]:
    fr3(tmp_path / "fr3.xml")
    environment = {**os.environ, "FR3_MJCF": str(tmp_path / "fr3.xml")}
    with subprocess.Popen(
        [PYTHON, "-u", "-c", SERVER],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as server:
        assert server.stderr is not None
        assert any("ready for new client" in line for line in server.stderr)
        yield
        server.kill()


def seen(count: int) -> list[tuple[str, str]]:
    command = [sys.executable, "-m", "tests.hardware.with_libraries.strict_arm", str(count)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [(kind, text) for kind, text in json.loads(done.stdout.splitlines()[-1])]


@pytest.mark.usefixtures("strict")
def test_no_target_that_is_accepted_trips_a_reflex() -> None:
    faults = seen(TARGETS)
    assert [text for kind, text in faults if kind != "communication"] == []


@pytest.mark.usefixtures("strict")
def test_a_jump_trips_a_reflex_which_is_told_and_recovered_from() -> None:
    (kind, text), (state, tracking) = seen(0)
    assert kind == "reflex"
    assert "The left arm" in text
    assert tracking == "[False, True]"
    assert state == "ready"
