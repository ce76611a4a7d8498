"""Objects, followed from one look to the next: where they lie, or in a hand that holds them.

Each look is a little wrong in another way, and what lies still, or is held, is looked at many
times. So of each object the mean over looks is told, of which the last one counts `SHARE` or more,
in the frame in which it has moved least since then: that of the table, or of one of the tools.
What has moved in all of these by more than looks are wrong is believed as it is seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from frames import QUARTERS, Frames, rotations_by, turns_between
from numpy.typing import NDArray

from duobench.core.types import SIDES

Array = NDArray[np.float64]
SHARE = 0.3
"""Least share of one look in the mean."""
FURTHEST = 0.004, math.radians(5.0)
"""How far (m, rad) what is seen is at most from where an object was followed to."""


@dataclass(frozen=True)
class _Mean:
    """What is known of K objects after some looks."""

    tools: tuple[Array, Array]
    """Places (2, 3) and rotations (2, 3, 3) of both tools at the last one."""
    places: Array
    """Places (K, 3)."""
    turns: Array
    """Rotations (K, 3, 3), but for quarters of a turn."""
    quarters: Array
    """How many looks said by how many quarters these are turned further (K, 4)."""


class Tracks:
    """Objects, followed through one episode.

    Args:
        turned: Which of them (K,) have axes; others are told to be turned as the table is.
    """

    def __init__(self, turned: NDArray[np.bool_]) -> None:
        self._turned = turned
        self._mean: _Mean | None = None

    def follow(self, seen: Frames) -> tuple[Array, Array]:
        """Places (K, 3) and rotations (K, 3, 3) of objects in the mean over looks.

        Args:
            seen: The frames of one state, in which objects are where the next look sees them.
        """
        tools, things = slice(len(SIDES)), slice(len(SIDES), -1)
        hands = seen.positions[0, tools], seen.rotations[0, tools]
        places, turns = seen.positions[0, things], seen.rotations[0, things]
        further = seen.quarters[0, things]
        votes = np.zeros((len(places), QUARTERS))
        if self._mean is not None:
            near, before = self._followed(hands, places, turns)
            votes[near] = self._mean.quarters[near]
            share = np.maximum(1 / (votes.sum(1) + 1), SHARE)[:, None]
            ahead, off = _apart(before[1], turns)
            further = further + np.where(near, ahead, 0)
            nearer = before[0] + share * (places - before[0])
            turned = rotations_by(share * off) @ before[1]
            places = np.where(near[:, None], nearer, places)
            turns = np.where(near[:, None, None], turned, turns)
        votes[np.arange(len(votes)), further % QUARTERS] += 1
        self._mean = _Mean(hands, places, turns, votes)
        return places, turns @ _BY_QUARTERS[votes.argmax(1)]

    def _followed(
        self, hands: tuple[Array, Array], places: Array, turns: Array
    ) -> tuple[NDArray[np.bool_], tuple[Array, Array]]:
        """Which objects (K,) are near where they were followed to, and poses there."""
        mean = self._mean
        assert mean is not None
        turned = np.stack([np.eye(3), *(hands[1] @ mean.tools[1].swapaxes(-1, -2))])
        before = np.stack([np.zeros(3), *mean.tools[0]])
        after = np.stack([np.zeros(3), *hands[0]])
        ways = mean.places - before[:, None]
        there = (turned[:, None] @ ways[..., None])[..., 0] + after[:, None]
        then = turned[:, None] @ mean.turns
        then = np.where(self._turned[:, None, None], then, np.eye(3))
        away = np.linalg.norm(there - places, axis=-1) / FURTHEST[0]
        angle = np.linalg.norm(_apart(then, turns)[1], axis=-1) / FURTHEST[1]
        best = np.hypot(away, angle).argmin(0)
        each = best, np.arange(len(places))
        near = np.maximum(away, angle)[each] < 1
        return near, (there[each], then[each])


def _apart(turns: Array, others: Array) -> tuple[NDArray[np.int64], Array]:
    """By how many quarters about z others (..., 3, 3) are turned further, and by which vectors."""
    others = np.broadcast_to(others, turns.shape)
    all_ways = others[..., None, :, :] @ _BY_QUARTERS.swapaxes(-1, -2)
    alike = np.einsum("...qij,...ij->...q", all_ways, turns)
    best = alike.argmax(-1)
    nearest = np.take_along_axis(all_ways, best[..., None, None, None], -3)[
        ..., 0, :, :
    ]
    return best, turns_between(turns, nearest)


def _by_quarters() -> Array:
    angles = np.zeros((QUARTERS, 3))
    angles[:, 2] = np.arange(QUARTERS) * 2 * math.pi / QUARTERS
    return rotations_by(angles).round()


_BY_QUARTERS = _by_quarters()
"""Rotations about z by quarters of a turn (4, 3, 3)."""
