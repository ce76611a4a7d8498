"""Transfer-Cube.

Task:
    One arm picks up the cube, a block three times as long as thick so that two grippers fit, and
    hands it to the other arm, which puts it into the bowl on its side of the table.

Randomization:
    The cube lies anywhere in the right half within 17.5 cm of its place at any yaw, the bowl within
    5 cm of its place.

Success:
    The cube rests in the bowl and no gripper touches it, brought by the arm that received it from
    the one that picked it up, and let go above the bowl or in it.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

from duobench.randomness import ANY_YAW, around
from duobench.solids.blocks import CUBE_EDGE, LONG_BLOCK, WHITE, long_block
from duobench.solids.bowl import RADIUS, WALL, bowl
from duobench.solids.prop import Prop
from duobench.stages.handover import handover
from duobench.stages.predicates import (
    CylinderRegion,
    all_of,
    any_of,
    inside,
    lifted_by_any,
    raised,
    released,
    rests_on,
    since,
)
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task

CUBE, BOWL = "cube", "bowl"
IN_BOWL = CylinderRegion(body=BOWL, radius=RADIUS - WALL, low=0.0, high=0.6 * LONG_BLOCK)
"""Where the cube's centre is when it lies, leans or stands in the bowl."""
BELOW_RIM = 0.020
"""The cube's lowest point is less than this above the table, in metres: not on top of the rim."""

_CUBE = handover(CUBE, BOWL)
# It was held above the bowl and has not left the space above it since: neither thrown nor pushed.
_OVER_BOWL = inside(CUBE, replace(IN_BOWL, high=inf))
_PUT_IN = since(lifted_by_any(CUBE, BOWL) & _OVER_BOWL, reset=~_OVER_BOWL)

TASK = Task(
    id="transfer_cube",
    title="Transfer-Cube",
    category=Category.SEQUENTIAL_HANDOFF,
    instruction="Pick up the cube, hand it to the other arm and put it into the bowl.",
    horizon=441,
    props=(
        Prop(name=CUBE, solid=long_block(WHITE)),
        Prop(name=BOWL, solid=bowl(WHITE)),
    ),
    placements={
        CUBE: Placement(x=around(0.5, 0.175), y=around(-0.2, 0.175), z=CUBE_EDGE / 2, yaw=ANY_YAW),
        BOWL: Placement(x=around(0.6, 0.05), y=around(0.3, 0.05)),
    },
    stages=(
        Stage(
            name="the cube is held",
            instruction="Pick up the cube.",
            holds=lifted_by_any(CUBE, BOWL),
        ),
        Stage(
            name="both grippers hold the cube",
            instruction="Grip the cube with the other arm as well.",
            holds=_CUBE.shared,
        ),
        Stage(
            name="the other arm holds the cube",
            instruction="Let the other arm take the cube.",
            holds=any_of(*_CUBE.received.values()),
        ),
        Stage(
            name="the cube is in the bowl",
            instruction="Put the cube into the bowl and let go.",
            holds=all_of(
                inside(CUBE, IN_BOWL),
                rests_on(CUBE, BOWL),
                ~raised(CUBE, BELOW_RIM),
                released(CUBE),
                _PUT_IN,
                any_of(*_CUBE.delivered.values()),
            ),
        ),
    ),
    printable=True,
    real=True,
)
