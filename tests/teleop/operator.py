"""A scripted operator: hands that follow the tool poses of an expert, as messages of a page.

It looks at the same simulation as an expert does, and sends what a page would: poses of two hands
in a frame of the operator's own, squeezes and triggers.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.envs.sim_env import sim_of
from duobench.tasks.experts.expert import find_script
from duobench.tasks.experts.motion import Arms
from duobench.teleop.messages import Message
from duobench.teleop.teleoperation import Teleoperation, TeleopState
from duobench.web.messages import reader
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT

ROOM_FROM_WORLD = SE3.at(0.3, -0.2, 1.1)
"""The operator stands somewhere else; the axes are those of the room."""
HELD = {side: SE3.about((0.2, 1.0, 0.3), 0.7 + side.index) for side in SIDES}
"""Nobody holds a controller as the robot holds its tool."""


HOMES = {side: SE3.at(0.1, 0.2 * side.sign, 0.3) for side in SIDES}
"""Two hands beside each other, for sessions that are led without an expert."""
NEITHER = {"left": False, "right": False}
"""The clutches while no arm is led."""


def led(*, left: bool = False, right: bool = False) -> dict[str, bool]:
    """The clutches while some arms are led."""
    return {"left": left, "right": right}


def hand(pose: SE3, *, squeeze: float = 0.0, trigger: float = 0.0, **more: Any) -> dict[str, Any]:
    """A hand of a message."""
    numbers = [*pose.translation.tolist(), *pose.wxyz.tolist()]
    return {"pose": numbers, "sure": True, "squeeze": squeeze, "trigger": trigger, **more}


def message(number: int, left: Any, right: Any, sent: float | None = None, **more: Any) -> bytes:
    """A message, by default one of thirty a second."""
    when = 1000.0 * number / CONTROL_HZ if sent is None else sent
    said = {"kind": "hands", "sent": when, "seq": number, "left": left, "right": right}
    said |= more
    return json.dumps(said).encode()


def said(text: bytes | str) -> Message:
    """A message as the page's server hands it on."""
    return read(text if isinstance(text, str) else text.decode())


read = reader(Message)


class Operator:
    """Leads one episode of a session after the other."""

    def __init__(self, session: Teleoperation, number: int = 0) -> None:
        self._session, self._number = session, number
        self._arms: Arms | None = None
        self._kinematics = Kinematics(ROBOT)

    def next_message(self) -> bytes:
        """What the page would send now."""
        state = self._session.state
        if state is TeleopState.DECIDE:
            self._arms = None
            return b'{"kind": "keep"}'
        squeeze = 1.0 if self._arms is not None else 0.0
        if self._arms is None and state is TeleopState.WAITING:
            self._begin()
        elif self._arms is not None:
            next(self._script, None)
        self._number += 1
        return message(self._number, *(self._hand(side, squeeze) for side in SIDES))

    def tools(self) -> dict[Side, SE3]:
        """Where the tools were led last."""
        command = sim_of(self._session.env).backend.last_command
        return dict(self._kinematics.forward(command.joints))

    def at_tools(self, squeeze: float) -> dict[str, Any]:
        """Both hands as they hold the tools where these were led last."""
        hands = {}
        for side, tool in self.tools().items():
            pose = ROOM_FROM_WORLD @ tool @ HELD[side]
            hands[str(side)] = {**self._hand(side, squeeze), "pose": hand(pose)["pose"]}
        return hands

    def _begin(self) -> None:
        env = sim_of(self._session.env)
        self._arms = Arms(env.simulation)
        self._script = find_script(env.definition)(self._arms)

    def _hand(self, side: Any, squeeze: float) -> dict[str, Any]:
        assert self._arms is not None
        pose = ROOM_FROM_WORLD @ self._arms.targets[side] @ HELD[side]
        trigger = float(np.clip(1.0 - self._arms.openings[side.index], 0.0, 1.0))
        return hand(pose, squeeze=squeeze, trigger=trigger)
