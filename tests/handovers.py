"""What tests of handoff tasks let the arms do besides what an expert does."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from duobench.experts.handling import pick
from duobench.experts.handover import Bar, clasp, pick_bar, present, receive_pose
from duobench.experts.motion import CAREFUL, Arms, Script, down, move, nearest_turn, release
from duobench.spatial import SE3
from duobench.types import Side


def bring(arms: Arms, side: Side, body: str, point: ArrayLike, *, above: float = 0.12) -> Script:
    """Carry an object, as it is held, to a point, from above."""
    # From where the tool is, not from its target, which it may not have reached yet.
    held = arms.sim.position(body) - arms.tcp_pose(side).translation
    goal = SE3(arms.targets[side].rotation, np.asarray(point) - held)
    yield from move(arms, {side: arms.targets[side].moved(z=above)}, arrive=False)
    yield from move(arms, {side: goal.moved(z=above)})
    yield from move(arms, {side: goal}, speed=0.2)


def lower(arms: Arms, side: Side, body: str, height: float) -> Script:
    """Bring an object's lowest point straight to a height in metres."""
    way = height - arms.sim.min_height(body)
    goal = arms.targets[side].moved(z=way)
    yield from move(arms, {side: goal}, speed=CAREFUL, tolerance=0.001)


def drop(arms: Arms, *sides: Side) -> Script:
    """Open grippers and move up."""
    yield from release(arms, *sides)
    yield from move(arms, {side: arms.targets[side].moved(z=0.10) for side in sides})


def meet(
    arms: Arms, bar: Bar, centre: ArrayLike, *, rise: float, grip_at: float, slant: float = 0.0
) -> Script:
    """The giver picks up, the receiver grips as well: both hold the bar."""
    yield from pick_bar(arms, bar)
    yield from move(arms, {bar.giver: present(bar, centre, rise)})
    yield from clasp(arms, bar.giver.other, receive_pose(arms, bar, grip_at, slant))


def clear_of(arms: Arms, side: Side) -> Script:
    """Take an arm out of the other one's way."""
    yield from move(arms, {side: arms.targets[side].moved(y=0.25 * side.sign, z=0.10)})


def pick_lying(arms: Arms, side: Side, body: str, *, lift: float = 0.10) -> Script:
    """Pick a bar up by its middle, on whichever face it lies."""
    x, y, z = arms.sim.position(body)
    along = arms.sim.rotation(body)[:, 0]
    yaw = nearest_turn(math.atan2(along[1], along[0]), math.pi)
    yield from pick(arms, side, down(x, y, z + 0.012, yaw=yaw), lift=lift)
