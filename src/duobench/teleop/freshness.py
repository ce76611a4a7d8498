"""How old a sample is, by the clock of who sent it.

When a page or a network stalls, the samples of the stall arrive together afterwards. By their time
of arrival all of them are fresh; by the sender's clock most are not. The two clocks begin anywhere,
so the smallest delay of the last while stands for no delay at all.
"""

from __future__ import annotations

import math

MAX_AGE_S = 0.250
"""Samples that were delayed by more than this, in seconds, are dropped; and a hand of which nothing
was heard for as long is lost."""
WINDOW_S = 30.0
"""The smallest delay is that of the last one to two windows, in seconds: two clocks drift apart by
some milliseconds a minute, and one may have stood still."""


class Freshness:
    """Judges the samples of one connection."""

    def __init__(self) -> None:
        self.dropped = 0
        """Samples that were not fresh."""
        self._window_end = -math.inf
        self._least = self._least_before = math.inf
        self._newest = -math.inf

    def accepts(self, sent_ms: float, arrival_s: float) -> bool:
        """Whether a sample is fresh when it arrives, and newer than all before it.

        Args:
            sent_ms: When it was sent, in ms of the sender's clock.
            arrival_s: When it arrived, in seconds of our clock.
        """
        delay = arrival_s - sent_ms / 1000.0
        if arrival_s >= self._window_end:
            self._least_before = self._least if math.isfinite(self._window_end) else math.inf
            self._least, self._window_end = math.inf, arrival_s + WINDOW_S
        self._least = min(self._least, delay)
        is_late = delay - min(self._least, self._least_before) > MAX_AGE_S
        if is_late or sent_ms <= self._newest:
            self.dropped += 1
            return False
        self._newest = sent_ms
        return True
