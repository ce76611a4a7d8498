"""A person with one mouse and a keyboard, as a program: it moves, presses and looks, no more.

It knows where a tool is and where it shall be, and what the page's camera sees; all that it does is
to move the pointer, turn the wheel and press keys, one hand at a time, until the tool is there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from duobench.core.spatial import SE3, length, product, rotation_vector
from duobench.core.types import Array, Side
from duobench.envs.sim_env import sim_of
from duobench.teleop.teleop_page import LEADING_VIEW
from duobench.web.shading import as_camera
from tests.pages.leading import Led

NEAR, NEAR_TURN = 0.002, 0.015
"""How near in metres and radians a tool is brought to where it shall be."""
WHEEL, WHEEL_TURN, DRAG_TURN = 0.0002, 0.0005, 0.005
"""Metres and radians a pixel of the wheel, and radians a pixel of a drag, as the docs say."""
FAST, FAST_TURN = 0.05, 0.2
"""Metres and radians at a time."""
FINE, FINE_BELOW = 0.25, 0.015
"""What the fine key makes of a motion, and from which distance in metres on it is held."""
MOVED = 4
"""Messages in which a tool follows a part of a motion."""
SETTLED = 10
"""Messages in which a tool comes to rest, at sixty a second."""
GRIPPED = 30
"""Messages in which fingers come to rest."""
MOST_TRIES = 12
KEYS = {Side.LEFT: ("1", "g"), Side.RIGHT: ("2", "j")}
"""The keys that choose an arm, and that open and close its gripper."""


class MouseOperator:
    """Leads tools from the page of a session."""

    def __init__(self, led: Led) -> None:
        """Sit down in front of a page that drives."""
        self._led = led
        env = sim_of(led.session.env)
        self._backend = env.backend
        camera = as_camera(LEADING_VIEW)
        eye, target = (np.array(camera[name]) for name in ("eye", "target"))
        self._eye, self._forward = eye, (target - eye) / length(target - eye)
        right = np.cross(self._forward, (0.0, 0.0, 1.0))
        self._right = right / length(right)
        self._up = np.cross(self._right, self._forward)
        scene = led.page.locator("canvas").first
        scene.scroll_into_view_if_needed()
        box = scene.bounding_box()
        assert box
        self._middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        wider = max(1.0, (4 / 3) * box["height"] / box["width"])
        self._size = 2 * math.tan(math.radians(camera["fovy"]) / 2) * wider / box["height"]
        led.page.mouse.click(*self._middle)  # brings the scene into focus

    def tool(self, side: Side) -> SE3:
        """Where a tool is."""
        return SE3.from_tquat(self._backend.read().tcp_poses[side.index])

    def lead(self, side: Side, goal: SE3, near: float = NEAR) -> None:
        """Bring a tool to a pose in the table frame: turn it, then move it."""
        self._led.page.keyboard.press(KEYS[side][0])
        for _ in range(MOST_TRIES):
            away, angle = self.tool(side).distance(goal)
            if angle > NEAR_TURN:
                self._turn(side, goal)
            elif away > near:
                self._move(side, goal)
            else:
                return
            self._led.follow(SETTLED)
        raise AssertionError(f"{side} is at {self.tool(side)} and cannot be led to {goal}")

    def grip(self, side: Side, opening: float) -> None:
        """Tap the key of a gripper, again where it was not noticed, and wait for the fingers."""
        for _ in range(MOST_TRIES):
            if self._backend.last_command.openings[side.index] == opening:
                break
            self._led.page.keyboard.press(KEYS[side][1])
            self._led.follow(4)
        self._led.follow(GRIPPED)

    def _move(self, side: Side, goal: SE3) -> None:
        """One drag in the plane of the view, with the wheel for what is away from it."""
        here = self.tool(side).translation
        shift = goal.translation - here
        size = length(shift)
        is_fine = size < FINE_BELOW
        pixel = self._size * float((here - self._eye) @ self._forward)
        motion = self._seen(shift) / np.array([pixel, -pixel, -WHEEL])
        self._drag(motion, size / FAST, "c" if is_fine else None, FINE if is_fine else 1.0)

    def _turn(self, side: Side, goal: SE3) -> None:
        """The same with Shift: the tool turns as a ball under the pointer."""
        turn = rotation_vector(product(goal.rotation, self.tool(side).rotation.T))
        right, up, forward = self._seen(turn)
        motion = np.array([up / DRAG_TURN, right / DRAG_TURN, forward / WHEEL_TURN])
        self._drag(motion, length(turn) / FAST_TURN, "Shift", 1.0)

    def _seen(self, vector: Array) -> Array:
        """A vector of the table frame along right, up and forward of the view."""
        return np.array([self._right, self._up, self._forward]) @ vector

    def _drag(self, motion: Array, parts: float, key: str | None, share: float) -> None:
        """Drag by pixels across and down, and turn the wheel, little by little."""
        page, done = self._led.page, np.zeros(3)
        count = max(1, math.ceil(parts / share))
        page.mouse.move(*self._middle)
        with self._held(key):
            page.mouse.down()
            for number in range(1, count + 1):
                wanted = np.round(motion / share * number / count)
                across, down, wheel = wanted - done
                if across or down:
                    page.mouse.move(self._middle[0] + wanted[0], self._middle[1] + wanted[1])
                if wheel:
                    page.mouse.wheel(0, wheel)
                self._led.follow(MOVED)
                done = wanted
            page.mouse.up()

    @contextmanager
    def _held(self, key: str | None) -> Iterator[None]:
        keyboard = self._led.page.keyboard
        if key:
            keyboard.down(key)
        yield
        if key:
            keyboard.up(key)
