"""A person at the keys of the page, as a program without a browser.

It presses one key at a time, for as long as it likes, and what it sees is rounded to a centimetre
and ten degrees. How far a key moves a tool is read from the page of controls.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.spatial import SE3, length, product, rotation_by, rotation_vector
from duobench.core.types import CONTROL_HZ, SIDES, Array, Side
from duobench.envs.sim_env import sim_of
from duobench.teleop.teleop_page import LEADING_VIEW
from duobench.teleop.teleoperation import Teleoperation, TeleopState
from duobench.web.shading import as_camera
from tests.docs.markdown import page_of, table
from tests.teleop.operator import hand, message, said

SEEN, SEEN_TURN = 0.01, math.radians(10)
"""What places and directions are rounded to when they are seen, in metres and radians."""
TAP_STEPS = 9
"""Control steps after which a key that is still pressed goes on moving: 300 ms."""
SETTLED, GRIPPED = 10, 30
"""Control steps in which a tool, and fingers, come to rest."""
MOST_PRESSES = 60
ARMS = {"1": Side.LEFT, "2": Side.RIGHT}
Key = tuple[tuple[str, ...], Array]
"""Keys that are pressed together, and the axis in the table frame along or about which they do."""
GRIPPERS = {"F": Side.LEFT, "J": Side.RIGHT}


def seen(place: ArrayLike, exactly: float = SEEN) -> Array:
    """A place or a turn as it is seen."""
    return np.round(np.asarray(place) / exactly) * exactly


def _amounts(key: str) -> tuple[float, float]:
    """What a tap of a key does, and a control step of holding it, in metres or radians."""
    does = {row["key"]: row["what it does"] for row in table(CONTROLS, "key")}[key]
    found = re.search(r"a tap is ([\d.]+) (mm|rad), holding goes on at ([\d.]+) (?:m|rad)/s", does)
    assert found, does
    tap = float(found[1]) / (1000 if found[2] == "mm" else 1)
    return tap, float(found[3]) / CONTROL_HZ


CONTROLS = page_of("teleoperation_controls")
MOVE, TURN = _amounts("arrow keys"), _amounts("Shift with any of these")


class Keyboard:
    """Leads the arms of a session in lockstep by the keys that a page has named so far."""

    def __init__(self, session: Teleoperation) -> None:
        self.session = session
        self._known: set[str] = set()
        env = sim_of(session.env)
        self.simulation, self._backend = env.simulation, env.backend
        camera = as_camera(LEADING_VIEW)
        forward = np.subtract(camera["target"], camera["eye"])
        forward /= length(forward)
        z = np.array([0.0, 0.0, 1.0])
        right, away = np.cross(forward, z), forward * (1, 1, 0)
        right, away = right / length(right), away / length(away)
        above = np.cross(right, forward)
        self._moves: list[Key] = [
            *((("arrow keys",), sign * axis) for axis in (right, away) for sign in (1, -1)),
            (("Page Up",), z),
            (("Page Down",), -z),
        ]
        self._turns: list[Key] = [
            *((("Shift", "arrow keys"), sign * one) for one in (right, above) for sign in (1, -1)),
            (("Shift", "Page Up"), forward),
            (("Shift", "Page Down"), -forward),
            (("Q",), z),
            (("E",), -z),
        ]
        self._side = Side.RIGHT
        self._hands = dict.fromkeys(SIDES, SE3())
        self._triggers = dict.fromkeys(SIDES, 0.0)
        self._sent = 0
        self.wait(SETTLED)

    @property
    def tool(self) -> SE3:
        """The tool of the arm that is led."""
        return SE3.from_tquat(self._backend.read().tcp_poses[self._side.index])

    def learn(self, *keys: str) -> None:
        """The page names keys."""
        self._known.update(keys)

    def take(self, *keys: str) -> None:
        """Press the keys among some that choose an arm."""
        for key in filter(ARMS.get, keys):
            self._side = ARMS[key]
            self.wait(SETTLED)

    def grip(self, *keys: str) -> None:
        """Press the keys among some that close or open a gripper."""
        for key in filter(GRIPPERS.get, keys):
            self._triggers[GRIPPERS[key]] = 1.0 - self._triggers[GRIPPERS[key]]
            self.wait(GRIPPED)

    def face(self, goal: Array) -> None:
        """Turn the tool until it is seen to have an orientation (3, 3)."""

        def lacking() -> Array:
            return rotation_vector(product(goal, self.tool.rotation.T))

        def turned(hand: SE3, axis: Array, angle: float) -> SE3:
            return SE3(product(rotation_by(angle * axis), hand.rotation), hand.translation)

        self._press_until(lacking, SEEN_TURN, self._turns, TURN, turned)

    def bring(self, goal: ArrayLike) -> None:
        """Move the tool until it is seen at a place (3,)."""

        def lacking() -> Array:
            return np.asarray(goal) - self.tool.translation

        def moved(hand: SE3, axis: Array, distance: float) -> SE3:
            return hand.moved(*(distance * axis))

        self._press_until(lacking, SEEN, self._moves, MOVE, moved)

    def wait(self, steps: int) -> None:
        """Press nothing."""
        for _ in range(steps):
            self._send(squeeze=0.0)

    def press(self, *keys: str) -> None:
        """Press keys, which the page must have named."""
        assert self._known.issuperset(keys), f"{keys} are not named by the page so far"

    def _press_until(
        self,
        lacking: Callable[[], Array],
        exactly: float,
        keys: list[Key],
        amounts: tuple[float, float],
        change: Callable[[SE3, Array, float], SE3],
    ) -> None:
        """Press the key that helps most, as long as it seems right, until nothing seems to lack."""
        for _ in range(MOST_PRESSES):
            gap = seen(lacking(), exactly)
            if not gap.any() or self.session.state is TeleopState.DECIDE:
                return
            names, axis = max(keys, key=lambda key: float(gap @ key[1]))
            self.press(*names)
            tap, held = amounts
            more = max(0, int((float(gap @ axis) - tap) / held))
            motion = [0.0, tap, *[0.0] * (TAP_STEPS if more else 0), *[held] * more]
            for amount in motion:
                self._hands[self._side] = change(self._hands[self._side], axis, amount)
                self._send(squeeze=1.0)
            for _ in range(SETTLED):
                self._send(squeeze=1.0)
            self._send(squeeze=0.0)
        raise AssertionError(f"{self._side} lacks {lacking()} after {MOST_PRESSES} keys")

    def _send(self, squeeze: float) -> None:
        self._sent += 1
        hands = (
            hand(
                self._hands[side],
                squeeze=squeeze if side is self._side else 0.0,
                trigger=self._triggers[side],
            )
            for side in SIDES
        )
        now = self._sent / CONTROL_HZ
        self.session.receive(said(message(self._sent, *hands, devices=["mouse"])), now)
        self.session.advance(now)
