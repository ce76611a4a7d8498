"""Whole tasks in an imitated headset: a program holds its controllers as a person would.

In lockstep, one control step for each message of the page: a busy machine draws a few frames a
second without a graphics card, and nobody leads an arm so.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page
from scipy.spatial.transform import Rotation

from duobench.core.types import SIDES
from duobench.data import Actor, DataSet, find_problems
from duobench.envs.sim_env import sim_of
from duobench.teleop.teleoperation import TeleopState
from tests.pages.leading import Led, follower, led
from tests.pages.test_headset import BARE, IWER, LOOK, ROOM_FROM_WORLD, ROOM_HEAD, WEAR, in_room
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


def say(page: Page, button: str) -> None:
    """Press a button of the right controller."""
    page.evaluate(f"worn.controllers.right.updateButtonValue('{button}', 1)")


@dataclass
class Wearer:
    """Holds controllers, or bare hands, as an operator says, until its session is over."""

    one: Led
    hold: Callable[[Page, dict[str, Any]], None] = hold
    keep: Callable[[Page], None] = lambda page: say(page, "a-button")

    def __post_init__(self) -> None:
        self.operator = Operator(self.one.session)

    @property
    def is_over(self) -> bool:
        return self.one.session.state is TeleopState.OVER

    def enter(self) -> None:
        """Put the headset on with open hands, which have to be seen first."""
        self._wanted = json.loads(self.operator.next_message())
        self.hold(self.one.page, self._wanted)
        self.one.page.get_by_role("button", name="Enter VR").click()

    def follow(self) -> None:
        """Hold the hands as the operator says next, until the session has seen them so."""
        if self._wanted["kind"] == "keep":
            self.keep(self.one.page)
        else:
            self.hold(self.one.page, self._wanted)
        while not self.is_over:
            self.one.turn()
            if self._wanted["kind"] == "keep" or self._is_seen(self._wanted):
                break
        if not self.is_over:
            self._wanted = json.loads(self.operator.next_message())

    def squeeze_anew(self) -> None:
        """Bring both hands to where the tools are, open them, and close them again."""
        for squeeze in (0.0, 1.0):
            hands = self.operator.at_tools(squeeze)
            self.hold(self.one.page, hands)
            while not self._is_seen(hands):
                self.one.turn()
        self.one.follow(1)

    def _is_seen(self, hands: dict[str, Any]) -> bool:
        return bool(self.one.samples) and is_held(self.one.samples[-1], hands)


def check_solved(folder: Path, actor: Actor) -> None:
    """One episode was recorded, and is whole and solved."""
    data = DataSet.open(folder)
    (recording,) = data.recordings()
    assert recording.info.actor == actor
    assert recording.info.outcome is not None
    assert recording.info.outcome.success
    assert not find_problems(data)


@pytest.mark.parametrize("task", ["carry_pot", "transfer_cube"])
def test_a_task_is_solved_in_a_headset(tmp_path: Path, task: str) -> None:
    actor = follower("headset")
    with led(tmp_path, task, actor, WINDOW, IWER, WEAR) as one:
        wearer = Wearer(one)
        wearer.enter()
        while not wearer.is_over:
            wearer.follow()
    check_solved(tmp_path, actor)


CUTS = 20
CUT_EVERY = 7
"""Control steps from one cut to the next."""
STILL = 0.002
"""Metres and radians by which a tool moves that is not led."""


@pytest.mark.long
def test_a_task_is_solved_though_the_connection_is_cut_twenty_times(tmp_path: Path) -> None:
    """Nothing moves before the hands were opened and closed again; nothing else is touched."""
    actor = follower("headset")
    with led(tmp_path, "carry_pot", actor, WINDOW, IWER, WEAR) as one:
        session = one.session
        contacts = sim_of(session.env).simulation.contacts
        wearer = Wearer(one)
        wearer.enter()
        cuts = steps = 0
        touched = set[str]()
        while not wearer.is_over:
            wearer.follow()
            steps += 1
            touched |= {
                owner
                for owner in contacts.owners
                for side in SIDES
                if not owner.startswith(f"{side}/") and contacts.gripper(side, owner)
            }
            is_led = session.state is TeleopState.RECORDING
            if cuts == CUTS or steps % CUT_EVERY or not is_led:
                continue
            cuts += 1
            one.cut()
            while any(session.device.clutch):  # until the session knows of it
                one.turn()
            before = wearer.operator.tools()
            count = len(one.samples)
            while len(one.samples) < count + 5:  # the role has come back, and the hands are held on
                one.turn()
            assert one.samples[-1]["right"]["squeeze"] == 1.0
            assert not any(session.device.clutch)
            for side, tool in wearer.operator.tools().items():
                assert max(tool.distance(before[side])) < STILL
            wearer.squeeze_anew()
            while session.state is TeleopState.RECORDING and not all(session.device.clutch):
                one.turn()
    assert cuts == CUTS
    assert touched == {"pot/left_handle", "pot/right_handle"}
    check_solved(tmp_path, actor)


HANDS = """([head, left, right]) => {
  worn.position.set(...head[0]); worn.quaternion.set(...head[1]);
  for (const [side, hand] of [["left", left], ["right", right]]) {
    worn.hands[side].position.set(...hand.place);
    worn.hands[side].quaternion.set(...hand.turn);
    shape(side, hand.squeeze > 0.5, pinchFor(hand.trigger));
  }
}"""


@pytest.mark.long
def test_a_task_is_solved_by_bare_hands(tmp_path: Path) -> None:
    actor = follower("headset")

    def hold(page: Page, hands: dict[str, Any]) -> None:
        head = [ROOM_HEAD.tolist(), LOOK.as_quat().tolist()]
        page.evaluate(HANDS, [head, held(hands["left"]), held(hands["right"])])

    def keep(page: Page) -> None:
        is_asked = one.session.state is TeleopState.DECIDE
        page.evaluate("() => { shape('left', false, 0); shape('right', false, 0); }")
        page.wait_for_timeout(500)
        if is_asked:
            page.evaluate("shape('right', false, 1)")
            page.wait_for_timeout(1500)

    with led(tmp_path, "transfer_cube", actor, WINDOW, IWER, WEAR) as one:
        one.page.evaluate(BARE)
        wearer = Wearer(one, hold, keep)
        wearer.enter()
        while not wearer.is_over:
            wearer.follow()
    check_solved(tmp_path, actor)
