"""`duobench teleop` as a command: its page, its recording, and what it says."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ
from duobench.data import Actor, ActorKind, DataSet
from tests.teleop.operator import hand, message
from tests.web.pages import TIMEOUT_S, open_page

STEPS = 5


def lead(url: str) -> None:
    """Open both hands, squeeze them for some steps, and leave."""
    with open_page(url) as page:
        page.drive()
        for number in range(STEPS + 1):
            one = hand(SE3.at(z=0.002 * number), squeeze=float(number > 0))
            page.say(**json.loads(message(number, one, one, devices=["gamepad"])))
        page.hear_of("status", step=STEPS)
    with open_page(url) as page:
        assert page.hear_of("status", state="paused")["task"] == "carry_pot"


@pytest.mark.slow
def test_a_policy_plays_by_its_name_until_a_squeeze(tmp_path: Path) -> None:
    out = tmp_path / "people"
    command = [sys.executable, "-m", "duobench", "teleop", "carry_pot", "--out", str(out)]
    command += ["--policy", "hold", "--operator", "P07", "--lockstep"]
    squeezes = (0, 1, 0, 0, 0, 1, 1)  # open, begin, watch, take over
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            url = process.stdout.readline().split()[-1]
            with open_page(url) as page:
                page.drive()
                for number, squeeze in enumerate(squeezes):
                    one = hand(SE3.at(), squeeze=float(squeeze))
                    page.say(**json.loads(message(number, one, one, devices=["gamepad"])))
                status = page.hear_of("status", step=len(squeezes) - 1)
                assert status["policy"]["name"] == "hold"
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=TIMEOUT_S)
        finally:
            process.kill()
    (recording,) = DataSet.open(out).recordings()
    policy, person = recording.info.leaders
    assert (policy.kind, policy.name) == (ActorKind.POLICY, "hold")
    assert person == Actor(kind=ActorKind.PERSON, name="P07", device="gamepad")
    assert recording.leader.tolist() == [0, 0, 0, 0, 1, 1]


def test_ctrl_c_leaves_what_was_recorded_and_says_how_much(tmp_path: Path) -> None:
    out = tmp_path / "people"
    command = [sys.executable, "-m", "duobench", "teleop", "carry_pot", "--out", str(out)]
    command += ["--operator", "P07", "--scripted", "--lockstep", "--instruction", "Lift it."]
    command += ["--limit", "20"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            url = process.stdout.readline().split()[-1]
            assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=.+", url)
            lead(url)
            process.send_signal(signal.SIGINT)
            said, _ = process.communicate(timeout=TIMEOUT_S)
        finally:
            process.kill()
    assert process.returncode in {0, 130}, said
    assert "0 episodes of carry_pot in" in said
    (recording,) = DataSet.open(out).recordings()
    info = recording.info
    expected = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name="P07", device="gamepad")
    assert info.actor == expected
    assert info.instruction == "Lift it."
    assert info.task_instruction.startswith("Lift the pot")
    assert len(recording) == STEPS
    assert info.config is not None
    assert info.config.horizon == 20 * CONTROL_HZ
    assert info.outcome is not None
    assert not info.outcome.kept
