"""Carry-Pot.

Task:
    A pot stands in the right half of the table, a stove plate in the left one. The pot is heavy,
    and has a handle on either side: each arm grasps one, and both carry the pot to the plate.

Randomization:
    Pot within 8 cm of its place and turned by up to 10 degrees, plate within 4 cm of its place.

Success:
    The pot has stood upright on the plate for half a second, near its middle, let go, after both
    arms carried it there: in the air each of them grasped its handle, until it was put down.
"""

import math
from math import inf

from duobench.core.randomness import Uniform, around
from duobench.core.types import SIDES
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.coordination import carriage
from duobench.tasks.stages.logic import Predicate, all_of, any_of
from duobench.tasks.stages.placing import placed
from duobench.tasks.stages.predicates import (
    BoxRegion,
    inside,
    released,
    rests_on,
    touches,
    upright,
)
from duobench.tasks.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.pot import (
    HEIGHT,
    PLATE,
    pot,
    stove_plate,
)
from duobench.world.objects.prop import Prop

HANDLES = ("pot/left_handle", "pot/right_handle")
LIFT = 0.030
"""Least height in metres by which the pot is raised."""
TILT_DEGREES = 10.0
"""Largest tilt of a pot that stands upright."""
OFF_CENTRE = (0.10, 0.08)
"""Largest distance of the pot's centre from the plate's, along the plate's x and y, in metres."""
SHOVE = 0.03
"""Distance from there in metres where both arms may put it down: one arm may shove it that far."""
YAW = math.radians(10)
"""Largest turn of the pot at the start, in radians."""

ACROSS = math.pi / 2
"""Turn of the plate in radians: its long side lies across the table, so that the head sees all."""


def _over_plate(more: float = 0.0) -> Predicate:
    """The pot's centre is above the plate and near its, `more` metres further away at most."""
    x, y = (limit + more for limit in OFF_CENTRE)
    return inside(
        "pot", BoxRegion(body="stove", low=(-x, -y, PLATE[2]), high=(x, y, inf))
    )


_ON_PLATE = _over_plate()
_CARRIAGE = carriage(
    "pot", HANDLES, "stove", place=_over_plate(SHOVE), top=PLATE[2], height=LIFT
)
_RELEASED = all_of(*(released(body) for body in ("pot", *HANDLES)))
_TOUCHED = any_of(*(touches(side, handle) for side in SIDES for handle in HANDLES))

TASK = Task(
    id="carry_pot",
    title="Carry-Pot",
    category=Category.BIMANUAL_MANIPULATION,
    instruction=(
        "Lift the pot by both handles, one with each arm, carry it to the stove, put it down near "
        "the middle of the stove, and let go of it."
    ),
    paraphrases=paraphrases("carry_pot"),
    kept_paraphrases=kept_paraphrases("carry_pot"),
    horizon=450,
    props=(pot("pot"), Prop(name="stove", solid=stove_plate, fixed=True)),
    placements={
        "pot": Placement(
            x=around(0.5, 0.08),
            y=around(-0.1, 0.08),
            z=HEIGHT / 2,
            yaw=Uniform(-YAW, YAW),
        ),
        "stove": Placement(
            x=around(0.5, 0.04), y=around(0.3, 0.04), yaw=around(ACROSS, 0.0)
        ),
    },
    stages=(
        Stage(
            name="an arm touches a handle",
            instruction="Reach for a handle of the pot.",
            holds=_TOUCHED,
            stays=_TOUCHED | _CARRIAGE.put_down,
        ),
        Stage(
            name="both arms carry the pot",
            instruction="Grasp one handle with each arm, and lift the pot from the table.",
            holds=_CARRIAGE.carried,
            stays=_CARRIAGE.underway | _CARRIAGE.put_down,
        ),
        Stage(
            name="the pot stands on the stove",
            instruction="Carry the pot to the stove, put it down near the middle, and let go.",
            holds=all_of(
                placed(
                    rests_on("pot", "stove"),
                    _ON_PLATE,
                    upright("pot", math.radians(TILT_DEGREES)),
                    _RELEASED,
                ),
                _CARRIAGE.put_down,
            ),
        ),
    ),
    expert="duobench.tasks.experts.scripts.carry_pot:script",
)
