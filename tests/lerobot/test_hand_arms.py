"""Hands that lead joints without an environment."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from duobench.core.errors import MessageError
from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, DuoCommand
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from lerobot_env_duobench.hand_arms import HandArms
from tests.teleop.operator import hand, message, said

SHIFT = np.array([0.0, 0.05, 0.04])
STEPS = 45


class Lead:
    """Sends hands to arms of numbers, thirty times a second."""

    def __init__(self, **options: Any) -> None:
        self.arms = HandArms(**options)
        self.number = 0

    def step(self, **fields: Any) -> DuoCommand:
        """One step with both hands alike."""
        self.number += 1
        both = hand(fields.pop("pose", SE3.at()), **fields)
        now = self.number / CONTROL_HZ
        self.arms.receive(said(message(self.number, both, both)), now)
        return self.arms.advance(now)

    def lead(self, pose: SE3, **fields: Any) -> DuoCommand:
        """Bring the hands to a pose, and wait until the arms are there."""
        for step in range(STEPS):
            way = min(1.0, step / 20)
            self.step(pose=SE3.at().moved(*(way * pose.translation)), squeeze=1.0, **fields)
        return self.arms.command


@pytest.mark.parametrize("lockstep", [False, True])
def test_tools_move_as_the_hands_do(lockstep: bool) -> None:
    leader = Lead(lockstep=lockstep)
    begun = leader.arms.command
    assert leader.step(squeeze=1.0) is begun, "a hand that comes squeezed moves nothing"
    assert "Open both hands" in leader.arms.note
    leader.step()
    assert "Lead a tool" in leader.arms.note
    command = leader.lead(SE3.at(*SHIFT), trigger=0.75)
    kinematics = Kinematics(ROBOT)
    for side, home in kinematics.forward(ROBOT.home).items():
        moved = kinematics.forward(command.joints)[side].translation - home.translation
        np.testing.assert_allclose(moved, SHIFT, atol=2e-3)
        assert command.openings[side.index] == 0.25
    assert leader.arms.is_led
    np.testing.assert_allclose(leader.arms.where().flat, command.flat)


def test_arms_that_are_placed_stay_there_with_what_they_hold() -> None:
    leader = Lead()
    leader.step()
    led = leader.lead(SE3.at(*SHIFT), trigger=1.0)
    held = DuoCommand(joints=led.joints, openings=np.array([0.0, 1.0]))
    leader.arms.place(held)
    leader.step(pose=SE3.at(*SHIFT), squeeze=1.0)
    leader.step(pose=SE3.at(*SHIFT))
    command = leader.step(pose=SE3.at(*SHIFT), squeeze=1.0)
    np.testing.assert_allclose(command.flat, held.flat, atol=1e-3)


def test_a_tool_is_not_led_far_from_where_it_is_measured() -> None:
    leader = Lead()
    leader.step()
    stuck = leader.arms.where()
    for number in range(60):
        leader.number += 1
        now, pose = leader.number / CONTROL_HZ, SE3.at(0.01 * number, 0.0, 0.0)
        both = hand(pose, squeeze=1.0)
        leader.arms.receive(said(message(leader.number, both, both)), now)
        leader.arms.advance(now, measured=stuck)
    away = leader.arms.where().tcp_poses[:, :3] - stuck.tcp_poses[:, :3]
    assert np.linalg.norm(away, axis=1).max() < 0.11


def test_who_leaves_lets_go() -> None:
    leader = Lead()
    leader.step()
    leader.lead(SE3.at(*SHIFT))
    leader.arms.leave(leader.number / CONTROL_HZ)
    before = leader.arms.command
    after = leader.step(pose=SE3.at(0.3, 0.3, 0.3), squeeze=1.0)
    assert leader.arms.device.clutch == (False, False)
    np.testing.assert_allclose(after.flat, before.flat, atol=1e-2)


def test_decisions_are_told_once_by_buttons_and_by_the_page() -> None:
    leader = Lead()
    assert leader.arms.take_decision() is None
    leader.step(buttons={"keep": True})  # held from before
    assert leader.arms.take_decision() is None
    leader.step()
    leader.step(buttons={"keep": True})
    leader.step(buttons={"keep": True})
    assert [leader.arms.take_decision() for _ in range(2)] == ["keep", None]
    leader.arms.receive(said(b'{"kind": "discard"}'), 1.0)
    leader.arms.advance(1.0)
    assert leader.arms.take_decision() == "discard"
    leader.step(buttons={"restore": True})
    assert leader.arms.take_decision() is None


def test_what_is_no_message_is_refused() -> None:
    arms = HandArms()
    with pytest.raises(MessageError, match="instruction is said where"):
        arms.receive(said(b'{"kind": "instruction", "text": "Lift the pot."}'), 0.0)
    with pytest.raises(MessageError, match="cannot be restored"):
        arms.receive(said(b'{"kind": "restore"}'), 0.0)
    with pytest.raises(MessageError, match="refused"):
        arms.receive(said(b'{"kind": "hands"}'), 0.0)
    np.testing.assert_array_equal(arms.advance(0.0).flat, ROBOT.home_command.flat)
