"""Layouts beyond the range of training: each object that is placed at random lies outside."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from duobench.randomness import ANY_YAW, Uniform
from duobench.shifts import levels
from duobench.shifts.levels import level_for
from duobench.shifts.shift import LAYOUT, Shift
from duobench.spatial import SE3
from duobench.tasks.task import Placement, Task


@dataclass(frozen=True, kw_only=True, slots=True)
class OutsidePlacement(Placement):
    """A placement whose position lies beyond the ranges along at least one axis."""

    margin: float
    """How far beyond it may lie, in metres."""
    turn: float
    """How far it may be turned beyond the range of training, in radians."""

    def sample(self, rng: np.random.Generator) -> SE3:
        """One pose in the table frame, upright."""
        x, y = self.x.low, self.y.low
        while self._is_inside(x, y):
            x = _wider(self.x, self.margin).sample(rng)
            y = _wider(self.y, self.margin).sample(rng)
        is_any = self.yaw.high - self.yaw.low >= ANY_YAW.high - ANY_YAW.low
        yaw = self.yaw if is_any else _wider(self.yaw, self.turn)
        return SE3.at(x, y, self.z, yaw=yaw.sample(rng))

    def _is_inside(self, x: float, y: float) -> bool:
        return self.x.low <= x <= self.x.high and self.y.low <= y <= self.y.high


def shifted_task(task: Task, shift: Shift) -> Task:
    """A task whose layouts lie outside of the usual ones, if the shift says so.

    What never moves (a wall, painted squares) stays where it is.
    """
    level = level_for(shift, LAYOUT, task.id)
    if not level:
        return task
    return replace(
        task,
        placements={name: _outside(each, level) for name, each in task.placements.items()},
    )


def _outside(placement: Placement, level: int) -> Placement:
    if placement.x.low == placement.x.high and placement.y.low == placement.y.high:
        return placement
    return OutsidePlacement(
        x=placement.x,
        y=placement.y,
        z=placement.z,
        yaw=placement.yaw,
        margin=levels.MARGIN_METRES[level],
        turn=levels.MARGIN_RADIANS[level],
    )


def _wider(span: Uniform, margin: float) -> Uniform:
    return Uniform(span.low - margin, span.high + margin)
