"""Steps of scripts: what tests let the arms do besides what an expert does.

A script is written as a row of steps, `do(fetch, (drop, LEFT), (by, LEFT, {"z": 0.1}))`. A step is
a function of the arms, or a tuple of one and its other arguments, those with keywords in a
dictionary at its end. An argument that is a function is called with the arms when its turn comes.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handling import pick
from duobench.tasks.experts.handover import Bar, clasp, let_go, pick_bar, present, receive_pose
from duobench.tasks.experts.motion import (
    CAREFUL,
    Arms,
    Script,
    down,
    move,
    nearest_turn,
    release,
    together,
    wait,
)

Act = Callable[[Arms], Script]


def do(*steps: Act | tuple[Any, ...]) -> Act:
    """A script of steps, one after the other."""

    def script(arms: Arms) -> Script:
        for step in steps:
            act, *given = step if isinstance(step, tuple) else (step,)
            given = [each(arms) if callable(each) else each for each in given]
            options = given.pop() if given and isinstance(given[-1], dict) else {}
            yield from act(arms, *given, **options)

    script.__qualname__ = "do"  # the same one each time: a task's harness may take it up again
    return script


def pause(_arms: Arms, steps: int) -> Script:
    yield from wait(steps)


def to(arms: Arms, side: Side, goal: SE3, **options: float) -> Script:
    """Move a tool to a pose."""
    yield from move(arms, {side: goal}, **options)


def by(
    arms: Arms, side: Side, x: float = 0.0, y: float = 0.0, z: float = 0.0, **options: float
) -> Script:
    """Move a tool by so many metres."""
    yield from move(arms, {side: arms.targets[side].moved(x=x, y=y, z=z)}, **options)


def back(arms: Arms, side: Side, way: float, **options: float) -> Script:
    """Draw a tool back along itself by so many metres."""
    yield from move(arms, {side: arms.targets[side] @ SE3.at(z=-way)}, **options)


def bring(arms: Arms, side: Side, body: str, point: ArrayLike, *, above: float = 0.12) -> Script:
    """Carry an object, as it is held, to a point, from above."""
    # From where the tool is, not from its target, which it may not have reached yet.
    held = arms.sim.position(body) - arms.tcp_pose(side).translation
    goal = SE3(arms.targets[side].rotation, np.asarray(point) - held)
    yield from by(arms, side, z=above, arrive=False)
    yield from to(arms, side, goal.moved(z=above))
    yield from to(arms, side, goal, speed=0.2)


def lower(arms: Arms, side: Side, body: str, height: float) -> Script:
    """Bring an object's lowest point straight to a height in metres."""
    way = height - arms.sim.min_height(body)
    yield from by(arms, side, z=way, speed=CAREFUL, tolerance=0.001)


def drop(arms: Arms, *sides: Side) -> Script:
    """Open grippers and move up."""
    yield from release(arms, *sides)
    yield from move(arms, {side: arms.targets[side].moved(z=0.10) for side in sides})


def meet(
    arms: Arms, bar: Bar, centre: ArrayLike, *, rise: float, grip_at: float, slant: float = 0.0
) -> Script:
    """The giver picks up, the receiver grips as well: both hold the bar."""
    yield from pick_bar(arms, bar)
    yield from to(arms, bar.giver, present(bar, centre, rise))
    yield from clasp(arms, bar.giver.other, receive_pose(arms, bar, grip_at, slant))


def hand_back(arms: Arms, giver: Side) -> Script:
    """Both hold the bar: the giver lets go and takes it again, and the other one leaves."""
    held_here = arms.targets[giver]
    yield from let_go(arms, giver)
    yield from clasp(arms, giver, held_here)
    yield from let_go(arms, giver.other)
    yield from clear_of(arms, giver.other)


def clear_of(arms: Arms, side: Side) -> Script:
    """Take an arm out of the other one's way."""
    yield from by(arms, side, y=0.25 * side.sign, z=0.10)


def pick_lying(arms: Arms, side: Side, body: str, *, lift: float = 0.10) -> Script:
    """Pick a bar up by its middle, on whichever face it lies."""
    x, y, z = arms.sim.position(body)
    along = arms.sim.rotation(body)[:, 0]
    yaw = nearest_turn(math.atan2(along[1], along[0]), math.pi)
    yield from pick(arms, side, down(x, y, z + 0.012, yaw=yaw), lift=lift)


def at_once(_arms: Arms, *scripts: Script) -> Script:
    """Run scripts side by side; as steps, functions of the arms."""
    yield from together(*scripts)
