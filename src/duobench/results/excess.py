"""How far a policy asked for more than the arms do, and which wrong unit or order explains it.

No score depends on it, and no replay can show it: what was asked for is not what was sent.
"""

import math
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
NO_RADIANS, NEAR = 4 * math.pi, 0.5
"""Joint targets beyond two full turns are hardly radians. So near must be what explains them: in
degrees (148 at home) the range, and to a first target the arms with left and right exchanged."""
FAST = 1.1
"""Part of its speed limit that no joint exceeds unless something drives it, such as a collision."""
NO_OPENING, FULLY_OPEN = 10.0, 255.0
"""Openings from the first to the second are hardly parts of one, which are overshot by little."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Excess:
    """How far what was requested in an episode went beyond limits of the arms."""

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
        cls, requested: Sequence[Array], sent: ArrayLike, speed: float, limits: DuoLimits
    ) -> Self:
        """From commands (1 + steps, 16) that were requested, and those (steps, 16) that were sent.

        The first of the former is where the arms were at the start.
        """
        ends = np.clip(requested, limits.low, limits.high).reshape(-1, len(SIDES), SIDE_SIZE)
        targets = np.reshape(requested, ends.shape)
        arms, joints = targets[0, :, :-1], targets[..., :-1]
        first = joints[(np.abs(joints - arms).max(axis=(1, 2)) > NOTABLE).argmax()]
        return cls(
            joint=_furthest(joints, ends[..., :-1]),
            opening=_furthest(targets[..., -1], ends[..., -1]),
            change=float(np.abs(np.subtract(requested[1:], sent)).max()),
            first=(float(np.abs(first - arms).max()), float(np.abs(first - arms[::-1]).max())),
            speed=speed,
        )

    @property
    def questions(self) -> list[str]:
        """Mistakes that would explain it, one question each."""
        (joint, end), (here, exchanged) = self.joint, self.first
        out = math.copysign(1.0, joint) * (math.radians(joint) - end)
        mistakes = {
            "are these degrees?": abs(joint) >= NO_RADIANS and out < NEAR,
            "are openings 0 to 100 or 255?": NO_OPENING <= self.opening[0] <= FULLY_OPEN,
            "are the arms in the other order?": exchanged < NEAR < here - exchanged,
        }
        return [question for question, explains in mistakes.items() if explains]

    def __str__(self) -> str:
        """What went how far, with the questions."""
        far = [
            f"{what} went to {target:.4g} where {end:.4g} is the limit"
            for what, (target, end) in {
                "joint targets": self.joint,
                "openings": self.opening,
            }.items()
            if abs(target - end) > NOTABLE
        ] or [f"joints were to move {self.change:.2g} rad too far in a step"]
        if self.speed > FAST:
            far.append(f"joints turned at {self.speed:.2g} times their speed limits")
        return " ".join([", ".join(far), *map("({})".format, self.questions)])


def _furthest(targets: Array, ends: Array) -> tuple[float, float]:
    place = np.abs(targets - ends).argmax()
    return float(targets.flat[place]), float(ends.flat[place])
