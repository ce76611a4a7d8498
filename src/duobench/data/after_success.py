"""Recording on after success: while the hands open, retreat and come to rest."""

from __future__ import annotations

import math

from duobench.errors import OptionError
from duobench.types import CONTROL_HZ

AFTER_SUCCESS_S = 1.0
"""Seconds that a demonstration goes on by default.

Success may come soon after the command that opens the hand. A data set that ends there has few
labels for letting go and none for the retreat, and a loss that masks what lies beyond the end of an
episode, as that of ACT, may never learn them.
"""


def steps_after_success(seconds: float) -> int:
    """The control steps of that many seconds, rounded.

    Raises:
        OptionError: The seconds are negative or not finite.
    """
    if not (math.isfinite(seconds) and seconds >= 0.0):
        raise OptionError(
            f"after_success is a number of seconds from 0 (off) on, such as {AFTER_SUCCESS_S}; got "
            f"{seconds}."
        )
    return round(seconds * CONTROL_HZ)
