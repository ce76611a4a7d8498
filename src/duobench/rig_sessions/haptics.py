"""What an operator's hands are to feel: that fingers touch something, that an arm cannot follow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from duobench.data import Recorder
from duobench.types import SIDES, Side

if TYPE_CHECKING:
    from duobench.envs.sim_env import SimEnv
    from duobench.teleop.intent import Intent

TOUCH, LIMIT, LOSS = (0.4, 40), (0.8, 80), (1.0, 200)
"""Strength, 0 to 1, and length in ms of the pulse when fingers touch something, when an arm is kept
from where its hand wants it, and when a hand lets go, or is lost."""


class Feeling:
    """Collects pulses: one for each time that something begins."""

    def __init__(self, env: Recorder) -> None:
        """Watch the arms of an environment."""
        # Real arms are asked for no contacts: they have none to tell.
        self._sim = cast("SimEnv", env.base).simulation if hasattr(env.base, "simulation") else None
        self._pulses: list[dict[str, Any]] = []
        self._before: dict[tuple[Side, str], bool] = {}

    def begin(self) -> None:
        """A new episode: nothing is felt yet."""
        self._before.clear()

    def update(self, intent: Intent) -> None:
        """A control step is over."""
        for side in SIDES:
            self._note(side, "touch", self._touches(side), TOUCH)
            self._note(side, "limit", intent.limited[side.index], LIMIT)
            self._note(side, "loss", not intent.clutch[side.index], LOSS)

    def take(self) -> list[dict[str, Any]]:
        """The pulses since the last call, as the page's messages `pulse`."""
        pulses, self._pulses = self._pulses, []
        return pulses

    def _note(self, side: Side, what: str, is_so: bool, pulse: tuple[float, int]) -> None:
        if is_so and not self._before.get((side, what), True):
            strength, ms = pulse
            self._pulses.append(
                {"kind": "pulse", "side": str(side), "strength": strength, "ms": ms}
            )
        self._before[side, what] = is_so

    def _touches(self, side: Side) -> bool:
        """Whether a gripper touches anything but its own arm."""
        if self._sim is None:
            return False
        contacts = self._sim.contacts
        others = (owner for owner in contacts.owners if not owner.startswith(f"{side}/"))
        return any(contacts.gripper(side, owner) for owner in others)
