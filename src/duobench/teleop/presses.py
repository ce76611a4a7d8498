"""Buttons on hands: what is newly pressed."""

from __future__ import annotations

from duobench.teleop.messages import Hands

KEEP, DISCARD = "keep", "discard"
"""Buttons that decide about an episode."""


class Presses:
    """Tells a press from holding on. A button that is held at first counts after a release."""

    def __init__(self) -> None:
        """Begin as if every button were held."""
        self._was_pressed = {KEEP: True, DISCARD: True}

    def new(self, hands: Hands) -> list[str]:
        """The buttons that were not pressed in the message before, keep first."""
        present = [hand.buttons for hand in (hands.left, hands.right) if hand is not None]
        pressed = {
            name: any(getattr(buttons, name) for buttons in present) for name in self._was_pressed
        }
        found = [name for name, is_so in pressed.items() if is_so and not self._was_pressed[name]]
        self._was_pressed = pressed
        return found
