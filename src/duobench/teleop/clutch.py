"""The clutch between a hand and a tool: while it is squeezed, the tool moves as the hand does."""

from __future__ import annotations

from duobench.spatial import SE3, product
from duobench.teleop.messages import Hand

CLOSES, OPENS = 0.5, 0.3
"""Squeeze from which the clutch closes, and below which it opens."""


class Clutch:
    """One hand's hold on one tool, which is also the dead man's switch.

    It closes on a squeeze that follows a release, so a hand that comes into view squeezed, or comes
    back after it was lost, moves nothing. Where it closes, the poses of hand and tool are noted;
    from there the tool moves by the same displacement, along the axes of the room, and turns by the
    same rotation about them, however the hand was held.
    """

    def __init__(self) -> None:
        self._is_armed = False
        self._anchor: tuple[SE3, SE3] | None = None

    @property
    def is_closed(self) -> bool:
        """Whether the hand leads the tool."""
        return self._anchor is not None

    def open(self) -> None:
        """Let go; it takes a release and a new squeeze to close again."""
        self._is_armed, self._anchor = False, None

    def wants(self, hand: Hand | None) -> bool:
        """Whether a hand, None if lost, keeps the clutch closed or would close it.

        A release arms it.
        """
        if hand is None or not hand.sure:
            self.open()
            return False
        if hand.squeeze < OPENS:
            self._is_armed, self._anchor = True, None
        return self.is_closed or (self._is_armed and hand.squeeze >= CLOSES)

    def follow(self, hand: Hand | None, tool: SE3) -> SE3 | None:
        """Where a hand, None if lost, leads a tool from where that was commanded to be last.

        Both poses are in the table frame; there is none while the clutch is open.
        """
        if not self.wants(hand) or hand is None:
            return None
        now = hand.world_from_hand
        if self._anchor is None:
            self._anchor = now, tool
        hand_then, tool_then = self._anchor
        shift = now.translation - hand_then.translation
        turn = product(now.rotation, hand_then.rotation.T)
        return SE3(product(turn, tool_then.rotation), tool_then.translation + shift)
