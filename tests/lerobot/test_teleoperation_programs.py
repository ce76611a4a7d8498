"""Programs of LeRobot lead our simulated robot by hands on the page, and record it."""

from __future__ import annotations

import os
import queue
import re
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest
from lerobot.datasets import LeRobotDataset
from websockets.exceptions import ConnectionClosedOK

from duobench.core.spatial import SE3
from duobench.envs.spaces import JOINT_NAMES
from duobench.policy.training.training import LearningData
from duobench.world.robot.frames import ROBOT
from tests.lerobot.tools import SCRIPTS
from tests.teleop.operator import hand, message
from tests.web.pages import Page, open_page

SECONDS = 4
FPS = 30
SIMULATED = ("--robot.type=duobench",)
RIG = ("--robot.type=duobench_duo", "--robot.rig=rehearsal", "--robot.ask=false")
"""Our two robots: the tasks in simulation, and real arms, here of a rig that is computed."""


def run(words: list[str], folder: Path, title: str = "Transfer-Cube") -> str:
    """Run a program of LeRobot, and raise both tools 3 cm while it runs; what it printed.

    Args:
        words: The program and its arguments.
        folder: Where LeRobot may write.
        title: What the page shows when the robot is there.
    """
    process = subprocess.Popen(
        [str(SCRIPTS / words[0]), *words[1:], "--teleop.type=duobench"],
        env={**os.environ, "HF_LEROBOT_HOME": str(folder / "home"), "HF_HUB_OFFLINE": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    assert process.stdout is not None
    lines: list[str] = []
    urls: queue.Queue[str] = queue.Queue()

    def listen() -> None:
        for line in process.stdout:
            lines.append(line)
            if found := re.search(r"Open (http\S+)", line):
                urls.put(found[1])

    listener = threading.Thread(target=listen)
    listener.start()
    try:
        with open_page(urls.get(timeout=120)) as page:
            page.say(kind="drive")
            page.hear_of("status", title=title)  # the robot is there
            lead_up(page)
    finally:
        process.wait(300)
        listener.join()
        process.stdout.close()
    assert process.returncode == 0, "".join(lines)[-3000:]
    return "".join(lines)


def lead_up(page: Page) -> None:
    """Send hands that rise, thirty times a second, until the program has had its time."""
    for number in range(1, 80):
        height = 0.03 * min(1.0, max(0, number - 15) / 30)
        both = hand(SE3.at(0.0, 0.0, height), squeeze=float(number > 10), trigger=0.0)
        try:
            page.connection.send(message(number, both, both).decode())
        except ConnectionClosedOK:  # on a slow machine that is before the last one
            return
        threading.Event().wait(1 / FPS)


robots = pytest.mark.parametrize(
    ("robot", "title"), [(SIMULATED, "Transfer-Cube"), (RIG, "LeRobot")], ids=["simulation", "rig"]
)


@robots
def test_lerobot_teleoperate_runs(robot: tuple[str, ...], title: str, tmp_path: Path) -> None:
    words = [*robot, "--robot.views=[]", f"--fps={FPS}", f"--teleop_time_s={SECONDS}"]
    assert "Teleop loop time" in run(["lerobot-teleoperate", *words], tmp_path, title)


@robots
def test_lerobot_record_records_what_can_be_trained_on(
    robot: tuple[str, ...], title: str, tmp_path: Path
) -> None:
    words = [
        *robot,
        "--robot.views=[head]",
        "--robot.image_size=64",
        "--dataset.repo_id=local/led",
        f"--dataset.root={tmp_path / 'set'}",
        "--dataset.single_task=Transfer the cube.",
        "--dataset.num_episodes=1",
        f"--dataset.episode_time_s={SECONDS}",
        f"--dataset.fps={FPS}",
        "--dataset.push_to_hub=false",
        "--dataset.rgb_encoder.vcodec=h264",
        "--play_sounds=false",
    ]
    run(["lerobot-record", *words], tmp_path, title)
    dataset = LeRobotDataset("local/led", root=tmp_path / "set", video_backend="pyav")
    actions = np.array([dataset[row]["action"].numpy() for row in range(len(dataset))])
    states = np.array([dataset[row]["observation.state"].numpy() for row in range(len(dataset))])
    assert dataset.meta.robot_type == "franka_fr3_duo"
    np.testing.assert_allclose(actions[0], ROBOT.home_command.flat, atol=1e-6)
    assert np.abs(actions[-1] - actions[0]).max() > 0.01
    assert np.abs(states[-1] - actions[-1]).max() < 0.05
    assert dataset[0]["observation.images.head"].shape == (3, 64, 64)
    assert LearningData(tmp_path / "set").names["action"] == list(JOINT_NAMES)
