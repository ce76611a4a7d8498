"""Hinge-Chest.

Task:
    A cube goes into a small chest whose lid falls shut by itself: one arm lifts the lid by its
    front tab and holds it while the other puts the cube inside.

Randomization:
    The cube anywhere in the left half of the table at any yaw, the chest within 4 cm and 10
    degrees of its place on the right.

Success:
    The cube lies in the chest and no gripper touches it, after it had been held over the table
    while the lid was open.
"""

from __future__ import annotations

import math

from duobench.randomness import ANY_YAW, around
from duobench.solids.blocks import BLACK, CHARCOAL, CUBE_EDGE, WHITE, cube
from duobench.solids.chest import CAVITY, RIM_HEIGHT, WALL, chest
from duobench.solids.prop import Prop
from duobench.stages.predicates import (
    BoxRegion,
    all_of,
    hinge_open,
    inside,
    lifted_by_any,
    released,
    since,
    touching,
)
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task

OPEN_ANGLE = 0.8
"""Angle in radians from which on the lid counts as open."""

CAVITY_REGION = BoxRegion(
    body="chest",
    low=(-CAVITY[0] / 2, -CAVITY[1] / 2, WALL),
    high=(CAVITY[0] / 2, CAVITY[1] / 2, RIM_HEIGHT - CUBE_EDGE / 2),
)
"""Where the cube's centre is when the cube is in the cavity and does not stick out over its rim."""

_LID_OPEN = hinge_open("chest/lid", OPEN_ANGLE)
_CUBE_HELD = lifted_by_any("cube", "chest", "chest/lid")
_OPEN_AND_HELD = _LID_OPEN & _CUBE_HELD
_CUBE_IN = all_of(inside("cube", CAVITY_REGION), touching("cube", "chest"), released("cube"))

TASK = Task(
    id="hinge_chest",
    title="Hinge-Chest",
    category=Category.ASYMMETRIC_SUPPORT,
    instruction="Hold the lid of the chest open and put the black cube into the chest.",
    horizon=441,
    props=(
        Prop(name="cube", solid=cube(BLACK)),
        chest("chest", body=WHITE, lid=CHARCOAL),
    ),
    placements={
        "cube": Placement(x=around(0.5, 0.175), y=around(0.2, 0.175), z=CUBE_EDGE / 2, yaw=ANY_YAW),
        "chest": Placement(
            x=around(0.6, 0.04), y=around(-0.2, 0.04), yaw=around(0.0, math.radians(10))
        ),
    },
    stages=(
        Stage(
            name="the lid is open or the cube is held",
            instruction="Open the lid of the chest or pick up the cube.",
            holds=_LID_OPEN | _CUBE_HELD,
        ),
        Stage(
            name="the lid is open and the cube is held",
            instruction="Hold the lid open with one arm and the cube with the other.",
            holds=_OPEN_AND_HELD,
        ),
        Stage(
            name="the cube is in the chest",
            instruction="Put the cube into the chest and let go of it.",
            holds=all_of(_CUBE_IN, since(_OPEN_AND_HELD)),
        ),
    ),
    printable=True,
    real=True,
)
