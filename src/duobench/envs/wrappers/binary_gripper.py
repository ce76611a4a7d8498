"""Binary grippers: open or closed, nothing between."""

from __future__ import annotations

from typing import Any

from duobench.envs.duo_env import Transition
from duobench.envs.spaces import opening_slots
from duobench.envs.wrappers.base import DuoWrapper
from duobench.types import Array

THRESHOLD = 0.5
"""Openings from here on mean open."""


class BinaryGripper(DuoWrapper):
    """Rounds both openings of an action, in any action mode: 1 from one half on, otherwise 0."""

    def check_action(self, action: Any) -> Array:
        """The action with rounded openings, without executing it.

        Args:
            action: In the action mode: 16 numbers, or 14 with `cartesian_relative`.

        Returns:
            As many float64 numbers, with each opening 0 or 1.

        Raises:
            ActionError: The wrapped environment would reject it.
        """
        numbers = self.env.get_wrapper_attr("check_action")(action).copy()
        slots = opening_slots(len(numbers))
        numbers[slots] = numbers[slots] >= THRESHOLD
        return numbers

    def step(self, action: Any) -> Transition:
        """Advance one control step.

        Raises:
            ActionError: See `check_action`. Nothing was moved.
        """
        return self.env.step(self.check_action(action))
