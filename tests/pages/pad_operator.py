"""A person with a gamepad in front of the page, as a program: sticks, buttons and triggers.

Its time passes only while it waits; see `screen_operator`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from duobench.core.types import SIDES, Array, Side
from tests.pages.leading import Led
from tests.pages.screen_operator import PERIOD_MS, ScreenOperator

DEAD = 0.15
"""What a stick at rest may show."""
SPEED, TURN = 0.25, 1.0
"""Metres and radians a second of a stick at its end, as the docs say."""
TURNING, TOGETHER = 0, 1
"""Buttons A and B."""
BUMPERS = {Side.LEFT: 4, Side.RIGHT: 5}
TRIGGERS = {Side.LEFT: 6, Side.RIGHT: 7}
KEEP = 9
REST = [0.0, 0.0, 0.0, 0.0]
PACE = 0.5
"""How far sticks are pushed when something is brought to a place."""
EASE = 8
"""Messages in which a stick is barely pushed still: a tool that is let go stops where it is."""
BARELY = 0.004
GRIPPED = 30
CLOCK = """{
  const clock = performance.now.bind(performance);
  let [before, shown, left] = [clock(), clock(), 1000];
  window.pass_time = (ms) => { left += ms; };
  window.time_left = () => left;
  performance.now = () => {
    const next = clock();
    const passed = Math.min(4 * (next - before), 8, left);
    before = next;
    shown += passed;
    left -= passed;
    return shown;
  };
}"""
"""The same clock as `screen_operator` has, which says whether all that was granted has passed."""


def stick(share: float) -> float:
    """How far a stick is pushed for a share of its speed."""
    return math.copysign(DEAD + (1.0 - DEAD) * min(1.0, abs(share)), share) if share else 0.0


class PadOperator(ScreenOperator):
    """Leads tools by sticks, and looks from above: right is right, and up on the screen is away."""

    def __init__(self, led: Led) -> None:
        super().__init__(led)
        self.sides: tuple[Side, ...] = ()

    def lead(self, *sides: Side) -> None:
        """Press the bumpers of one arm, or those of both at once."""
        if sides == self.sides:
            return
        for pressed in (1, 0):
            for side in sides:
                self._push(BUMPERS[side], pressed)
            self._go(3)
        self.sides = sides

    def squeeze(self, opening: float, *sides: Side) -> None:
        """Press triggers as far as leaves the grippers at an opening."""
        for side in sides:
            self._push(TRIGGERS[side], 1.0 - opening)
        self._go(3)
        self.wait(GRIPPED)

    def sticks(self, axes: list[float], messages: int, button: int | None = None) -> None:
        """Push sticks by shares of their speed for so many messages, with a button held."""
        if button is not None:
            self._push(button, 1)
        self._page.evaluate(f"pad.axes = {[stick(axis) for axis in axes]}")
        self._go(messages)

    def release(self, button: int | None = None) -> None:
        """Let sticks and a button go."""
        self._page.evaluate(f"pad.axes = {REST}")
        if button is not None:
            self._push(button, 0)
        self._go(2)

    def push_by(self, ways: list[float], most: float, button: int | None = None) -> None:
        """Push sticks until they have led by so much along each axis, in metres or radians."""
        largest = max(map(abs, ways))
        messages = max(1, math.ceil(largest / (PACE * most) / (PERIOD_MS / 1000)))
        speeds = [way / (messages * PERIOD_MS / 1000) / most for way in ways]
        self.sticks(speeds, messages, button)
        self.sticks([math.copysign(BARELY, way) if way else 0.0 for way in ways], EASE, button)
        self.release(button)

    def shift(self, right: float, away: float, up: float = 0.0) -> None:
        """Move one tool, or both as one thing, by metres."""
        button = TOGETHER if len(self.sides) > 1 else None
        self.push_by([right, -away, 0.0, -up], SPEED, button)

    def yaw(self, angle: float) -> None:
        """Turn one tool about the vertical; positive is to the left."""
        self.push_by([0.0, 0.0, -angle, 0.0], TURN)

    def keep(self) -> None:
        """Press Start."""
        self._push(KEEP, 1)
        self._go(3)

    def _go(self, messages: int) -> None:
        """Let exactly the time of so many messages pass: sticks lead on as long as it does."""
        self._page.evaluate(f"pass_time({messages * PERIOD_MS})")
        while self._page.evaluate("time_left()") > 0:
            self._led.turn(0.02)
        self._led.follow(0)

    def _push(self, button: int, value: float) -> None:
        self._page.evaluate(f"push({button}, {value})")
