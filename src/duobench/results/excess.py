"""Distances by which a policy asked for more than the arms do.

No score depends on it, and no replay can show it: what was asked for is not what was sent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.backend import DuoLimits
from duobench.core.types import SIDE_SIZE, SIDES, Array

MOST, NOTABLE = 0.5, 0.05
"""Share of an episode's steps, and change in radians or parts of an opening, above which limits are
worth a word: a policy that learned to stay at the end of a range overshoots by less."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Excess:
    """Excess of an episode's requested targets over limits of the arms."""

    joint: tuple[float, float]
    """The joint target furthest out of its range and the end of that, in radians, equal if none."""
    opening: tuple[float, float]
    """The same of openings."""
    change: float
    """Largest change by a limit, that of speed included, in radians or parts of an opening."""
    first: tuple[float, float]
    """Distance of the first target that differs from the start, in radians, from where the arms
    were and from that with left and right exchanged: of the joint with the largest one."""
    speed: float
    """Largest speed of a joint after a control step, as a part of its limit."""

    @classmethod
    def of(
        cls,
        requested: Sequence[Array],
        sent: ArrayLike,
        speed: float,
        limits: DuoLimits,
    ) -> Self:
        """Compute the excess of requested commands (1 + steps, 16) over sent targets (steps, 16).

        The first of the former is where the arms were at the start.
        """
        ends = np.clip(requested, limits.low, limits.high).reshape(
            -1, len(SIDES), SIDE_SIZE
        )
        targets = np.reshape(requested, ends.shape)
        arms, joints = targets[0, :, :-1], targets[..., :-1]
        first = joints[(np.abs(joints - arms).max(axis=(1, 2)) > NOTABLE).argmax()]
        return cls(
            joint=_furthest(joints, ends[..., :-1]),
            opening=_furthest(targets[..., -1], ends[..., -1]),
            change=float(np.abs(np.subtract(requested[1:], sent)).max()),
            first=(
                float(np.abs(first - arms).max()),
                float(np.abs(first - arms[::-1]).max()),
            ),
            speed=speed,
        )

    @classmethod
    def furthest(cls, each: Sequence[Self]) -> Self:
        """The largest of every number over several episodes."""
        return cls(
            joint=max((one.joint for one in each), key=_distance),
            opening=max((one.opening for one in each), key=_distance),
            change=max(one.change for one in each),
            first=max(one.first for one in each),
            speed=max(one.speed for one in each),
        )


def _distance(pair: tuple[float, float]) -> float:
    return abs(pair[0] - pair[1])


def _furthest(targets: Array, ends: Array) -> tuple[float, float]:
    place = np.abs(targets - ends).argmax()
    return float(targets.flat[place]), float(ends.flat[place])
