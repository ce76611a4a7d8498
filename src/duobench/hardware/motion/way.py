"""Ways between two configurations of both arms that are worth a look."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from duobench.types import Array

LIFTED = ((1, -0.4), (3, -0.25))
"""Joints and changes in radians that lift and draw back a hand before it goes on."""


def candidates(start: Array, end: Array) -> Iterator[list[Array]]:
    """Ways from the simplest to longer ones.

    Args:
        start: Joint positions (2, 7) in radians where both arms are.
        end: Where they are to go.

    Yields:
        Joint positions (2, 7) to go through, `end` last: straight; one arm after the other; both
        lifted first; one lifted after the other, and then one after the other.
    """
    yield [end]
    for first in (0, 1):
        yield [_one(start, end, first), end]
    lifted = _lifted(start)
    yield [lifted, end]
    for first in (0, 1):
        yield [lifted, _one(lifted, end, first), end]
    for first in (0, 1):
        begun = _one(start, lifted, first)
        yield [begun, lifted, _one(lifted, end, first), end]
        yield [begun, _one(begun, end, first), end]


def _one(start: Array, end: Array, side: int) -> Array:
    """One arm at the end, the other one still where it is."""
    middle = np.array(start)
    middle[side] = end[side]
    return middle


def _lifted(start: Array) -> Array:
    from duobench.hardware.motion.follower import HIGHEST, LOWEST

    lifted = np.array(start)
    for joint, change in LIFTED:
        lifted[:, joint] += change
    return np.clip(lifted, LOWEST, HIGHEST)
