"""Carry-Pot.

Task:
    A pot stands in the right half of the table, a stove plate in the left one. Its handles hang on
    hinges near its bottom, so that a pot that is lifted by one of them tips over: both grippers
    take a handle each, carry the pot level, and put it onto the plate.

Randomization:
    Pot within 8 cm of its place and turned by up to 10 degrees, plate within 4 cm of its place.

Success:
    The pot stands upright on the plate, near its middle, after both grippers carried it and without
    having stood on the table since.
"""

from __future__ import annotations

import math

from duobench.randomness import Uniform, around
from duobench.scene.naming import TABLE
from duobench.solids.pot import HEIGHT, PLATE, pot, stove_plate
from duobench.solids.prop import Prop
from duobench.stages.predicates import (
    BoxRegion,
    all_of,
    any_of,
    grasped_apart,
    inside,
    off_table,
    raised,
    rests_on,
    since,
    touches,
    touching,
    upright,
)
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.types import SIDES

HANDLES = ("pot/left_handle", "pot/right_handle")
LIFT = 0.030
"""How far the pot is raised at least, in metres."""
TILT = math.radians(10)
"""Largest tilt of a pot that stands upright, in radians."""
OFF_CENTRE = (0.10, 0.08)
"""How far the pot's centre may be from the plate's, along the plate's x and y, in metres."""
YAW = math.radians(10)
"""Largest turn of the pot at the start, in radians."""

ACROSS = math.pi / 2
"""Turn of the plate in radians: its long side lies across the table, so that the head sees all."""

_CLEAR = all_of(*(off_table(body, "stove") for body in ("pot", *HANDLES)))
_CARRIED = all_of(grasped_apart(*HANDLES), _CLEAR, raised("pot", LIFT))
_ON_PLATE = inside(
    "pot",
    BoxRegion(
        body="stove",
        low=(-OFF_CENTRE[0], -OFF_CENTRE[1], PLATE[2]),
        high=(OFF_CENTRE[0], OFF_CENTRE[1], PLATE[2] + HEIGHT),
    ),
)
_OFF_TABLE = all_of(*(~touching(handle, TABLE) for handle in HANDLES))

TASK = Task(
    id="carry_pot",
    title="Carry-Pot",
    category=Category.BIMANUAL_MANIPULATION,
    instruction="Lift the pot by both handles and put it onto the stove.",
    horizon=450,
    props=(pot("pot"), Prop(name="stove", solid=stove_plate(), fixed=True)),
    placements={
        "pot": Placement(
            x=around(0.5, 0.08), y=around(-0.1, 0.08), z=HEIGHT / 2, yaw=Uniform(-YAW, YAW)
        ),
        "stove": Placement(x=around(0.5, 0.04), y=around(0.3, 0.04), yaw=around(ACROSS, 0.0)),
    },
    stages=(
        Stage(
            name="a gripper touches a handle",
            instruction="Reach for a handle of the pot.",
            holds=any_of(*(touches(side, handle) for side in SIDES for handle in HANDLES)),
        ),
        Stage(
            name="both grippers carry the pot",
            instruction="Grasp both handles and lift the pot.",
            holds=_CARRIED,
        ),
        Stage(
            name="the pot stands on the stove",
            instruction="Carry the pot to the stove and put it down.",
            holds=all_of(
                rests_on("pot", "stove"),
                _OFF_TABLE,
                _ON_PLATE,
                upright("pot", TILT),
                since(_CARRIED, reset=touching("pot", TABLE)),
            ),
        ),
    ),
)
