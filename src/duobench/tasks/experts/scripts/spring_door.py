"""Spring-Door: the left arm pulls the door open by its bar while the right brings the cube.

The left gripper grasps the bar from the left, level and far aslant to the door, and keeps its pose
against the door while it swings: its arm stays on its own side, far from its joints' limits, and
the whole right half is free for the other arm.
"""

import math

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handling import pick_cube, put_in
from duobench.tasks.experts.motion import (
    CAREFUL,
    NEAR,
    Arms,
    Script,
    down,
    follow,
    grip,
    move,
    together,
)
from duobench.world.objects.microwave import (
    BAR,
    FLOOR,
    FRONT,
    HEIGHT,
    HINGE,
)

HOLDER, INSERTER = Side.LEFT, Side.RIGHT
_ASLANT, _FROM_BELOW = -1.1, 1.75
"""Direction of the pulling tool: against the shut door's normal, and against straight down. Less
aslant, the wrist reaches its limits and the forearm the table; more, the hand touches the door."""
_BAR_HEIGHT = 0.19
"""Height of the grasp on the bar, in metres above the table."""
_AROUND_BAR = 0.55
"""Opening with which the fingers go around the bar."""
_OPEN_ANGLE = 1.15
"""Angle to which the door is opened, in radians."""
_ENOUGH = 1.05
"""Angle in radians from which on the other arm goes in."""
_PULL_SECONDS = 3.0

_ASIDE = (-0.04, -0.10, -0.05)
"""First way of the inserting tool, in metres: straight to the cube, a finger may come down on the
oven's edge."""
_GRASP_HEIGHT = 0.031
_GRASP_TILT = 0.1
"""Tilt of the picking tool; leaning further back, the wrist reaches its limits."""
_AZIMUTH, _SLOPE = -0.2, 0.78
"""Direction of the inserting tool: to the left of the oven's depth, and against straight down:
steep enough for the wrist to go on as it was when it picked, flat enough to fit under the roof."""
_INSIDE = (FRONT + 0.054, 0.068, FLOOR + 0.042)
"""Tool where it lets the cube go, in the oven's frame."""
_BEFORE = 0.10
"""How far the inserting tool stops ahead of where it lets go, along itself, in metres."""


def script(arms: Arms) -> Script:
    """Open the door, hold it open, put the cube in."""

    def is_open() -> bool:
        return arms.sim.angle("microwave/door") >= _ENOUGH

    bring = put_in(
        arms,
        INSERTER,
        fetch(arms),
        is_open,
        reach_in(arms),
        max_steps=500,
    )
    yield from together(open_door(arms), bring)


def at_bar(oven: SE3, angle: float) -> SE3:
    """Tool pose around the bar of the door, open by `angle` radians, camera downwards."""
    door = oven @ SE3.at(*HINGE) @ SE3.about((0, 0, -1), angle)
    aslant = down(
        0.0,
        0.0,
        0.0,
        yaw=_ASLANT,
        tilt=_FROM_BELOW,
    ) @ SE3.at(yaw=math.pi)
    height = _BAR_HEIGHT - HEIGHT / 2
    return door @ SE3(aslant.rotation, np.array([*BAR, height]))


def open_door(arms: Arms) -> Script:
    """The left arm pulls the door open by its bar and holds it."""
    oven = arms.sim.pose("microwave")
    arms.openings[HOLDER.index] = _AROUND_BAR
    shut = at_bar(oven, 0.0)
    yield from move(arms, {HOLDER: shut @ SE3.at(z=-0.12)}, tolerance=NEAR)
    yield from move(arms, {HOLDER: shut}, speed=0.2)
    yield from grip(arms, HOLDER)
    yield from follow(
        arms, lambda f: {HOLDER: at_bar(oven, f * _OPEN_ANGLE)}, _PULL_SECONDS
    )


def fetch(arms: Arms) -> Script:
    """The right arm picks up the cube."""
    aside = arms.targets[INSERTER].moved(*_ASIDE)
    yield from move(arms, {INSERTER: aside}, arrive=False)
    yield from pick_cube(
        arms,
        INSERTER,
        "cube",
        _GRASP_HEIGHT,
        tilt=_GRASP_TILT,
    )


def reach_in(arms: Arms, *, depth: float = 0.0) -> Script:
    """The right arm brings the cube into the cavity, by `depth` metres further than it needs."""
    inside = in_oven(arms, depth)
    yield from move(arms, {INSERTER: inside @ SE3.at(z=-_BEFORE)}, tolerance=NEAR)
    yield from move(arms, {INSERTER: inside}, speed=CAREFUL)


def in_oven(arms: Arms, depth: float = 0.0) -> SE3:
    """Tool pose at which the inserting arm lets the cube go, moved by `depth` metres inwards."""
    x, y, z = _INSIDE
    return arms.sim.pose("microwave") @ down(
        x + depth,
        y,
        z,
        yaw=_AZIMUTH,
        tilt=_SLOPE,
    )
