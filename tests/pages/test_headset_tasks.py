"""Whole tasks in an imitated headset: a program holds its controllers as a person would.

In lockstep, one control step for each message of the page: a busy machine draws a few frames a
second without a graphics card, and nobody leads an arm so.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page
from scipy.spatial.transform import Rotation

from duobench.data import DataSet, find_problems
from duobench.teleop.teleoperation import TeleopState
from tests.pages.leading import follower, led
from tests.pages.test_headset import IWER, LOOK, ROOM_FROM_WORLD, ROOM_HEAD, WEAR, in_room
from tests.teleop.operator import Operator

WINDOW = {"width": 640, "height": 400}
SHOWN = 2e-3
"""How near a sample is to where its controller was put, in metres and parts of a quaternion."""
SET = """([head, left, right]) => {
  worn.position.set(...head[0]); worn.quaternion.set(...head[1]);
  for (const [side, hand] of [["left", left], ["right", right]]) {
    const controller = worn.controllers[side];
    controller.position.set(...hand.place); controller.quaternion.set(...hand.turn);
    controller.updateButtonValue("squeeze", hand.squeeze);
    controller.updateButtonValue("trigger", hand.trigger);
  }
}"""


def held(hand: dict[str, Any]) -> dict[str, Any]:
    """A hand of a message as a controller in the room."""
    turn = Rotation.from_quat(hand["pose"][3:], scalar_first=True)
    return {
        "place": in_room(hand["pose"][:3]).tolist(),
        "turn": (ROOM_FROM_WORLD * turn).as_quat().tolist(),
        "squeeze": hand["squeeze"],
        "trigger": hand["trigger"],
    }


def hold(page: Page, hands: dict[str, Any]) -> None:
    """Hold both controllers so."""
    head = [ROOM_HEAD.tolist(), LOOK.as_quat().tolist()]
    page.evaluate(SET, [head, held(hands["left"]), held(hands["right"])])


def is_held(sample: dict[str, Any], hands: dict[str, Any]) -> bool:
    """Whether a sample of the page is of controllers that are held so."""
    for side in ("left", "right"):
        seen, wanted = sample[side], hands[side]
        if seen is None or not np.allclose(seen["pose"][:3], wanted["pose"][:3], atol=SHOWN):
            return False
        pressed = [[hand["squeeze"], hand["trigger"]] for hand in (seen, wanted)]
        if not np.allclose(*pressed, atol=SHOWN):
            return False
    return True


@pytest.mark.parametrize("task", ["carry_pot", "transfer_cube"])
def test_a_task_is_solved_in_a_headset(tmp_path: Path, task: str) -> None:
    actor = follower("headset")
    with led(tmp_path, task, actor, WINDOW, IWER, WEAR) as one:
        session, page, samples = one.session, one.page, one.samples
        operator = Operator(session)
        wanted = json.loads(operator.next_message())  # open hands, which have to be seen first
        hold(page, wanted)
        page.get_by_role("button", name="Enter VR").click()
        while session.state is not TeleopState.OVER:
            if wanted["kind"] == "keep":
                page.evaluate('worn.controllers.right.updateButtonValue("a-button", 1)')
            else:
                hold(page, wanted)
            while session.state is not TeleopState.OVER:
                one.turn()
                if wanted["kind"] == "keep" or (samples and is_held(samples[-1], wanted)):
                    break
            if session.state is not TeleopState.OVER:
                wanted = json.loads(operator.next_message())
    data = DataSet.open(tmp_path)
    (recording,) = data.recordings()
    assert recording.info.actor == actor
    assert recording.info.outcome is not None
    assert recording.info.outcome.success
    assert not find_problems(data)
