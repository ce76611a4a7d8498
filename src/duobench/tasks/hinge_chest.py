"""Hinge-Chest.

Task:
    A cube goes into a small chest whose lid falls shut by its own weight: one arm lifts the lid, by
    its lip for example, and supports it while the other arm puts the cube inside.

Randomization:
    The cube anywhere in the left half of the table at any yaw, the chest within 4 cm and 10
    degrees of its place on the right.

Success:
    The cube has rested in the chest for half a second, and no gripper touches it. The arm that
    brought it let it go at most 8 cm above the rim, and the other arm supported the lid, or was
    right behind it, until it was inside.
"""

import math
from dataclasses import replace
from math import inf

from duobench.core.randomness import ANY_YAW, around
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.placing import lifted_off, low_over, placed
from duobench.tasks.stages.predicates import (
    BoxRegion,
    hinge_open,
    inside,
    lifted_by_any,
    released,
    rests_on,
)
from duobench.tasks.stages.progress import Stage
from duobench.tasks.stages.support import support
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import (
    BLACK,
    CHARCOAL,
    CUBE_EDGE,
    WHITE,
    cube,
)
from duobench.world.objects.chest import (
    CAVITY,
    RIM_HEIGHT,
    WALL,
    chest,
)
from duobench.world.objects.prop import Prop

OPEN_ANGLE = 0.8
"""Angle in radians from which on the lid counts as open."""
BACKING = 0.060
"""How far in metres the hand that holds the lid may be behind it while it lies on the other one:
from where a lid opened by 1 rad is held, it goes that far to its stop."""

HIGHEST_DROP = 0.080
"""How high above the rim the cube's lowest point may be when it is let go, in metres: where the lid
stops a hand that comes straight down [task definitions]."""

CAVITY_REGION = BoxRegion(
    body="chest",
    low=(-CAVITY[0] / 2, -CAVITY[1] / 2, WALL),
    high=(CAVITY[0] / 2, CAVITY[1] / 2, RIM_HEIGHT - CUBE_EDGE / 2),
)
"""Region of the cube's centre when the cube is in the cavity and does not stick out over its
rim."""

_INSIDE = inside("cube", CAVITY_REGION)
_OVER = inside("cube", replace(CAVITY_REGION, high=(CAVITY[0] / 2, CAVITY[1] / 2, inf)))
_LID = support(
    "cube",
    "chest",
    "chest/lid",
    OPEN_ANGLE,
    goal=_INSIDE,
    there=_OVER & low_over("cube", "chest", RIM_HEIGHT, HIGHEST_DROP),
    again=lifted_off("cube", "chest", WALL),
    backing=BACKING,
)
_BEGUN = hinge_open("chest/lid", OPEN_ANGLE) | lifted_by_any(
    "cube", "chest", "chest/lid"
)

TASK = Task(
    id="hinge_chest",
    title="Hinge-Chest",
    category=Category.ASYMMETRIC_SUPPORT,
    instruction=(
        "Hold the lid of the chest open with one arm and lower the black cube into the chest with "
        "the other."
    ),
    paraphrases=paraphrases("hinge_chest"),
    kept_paraphrases=kept_paraphrases("hinge_chest"),
    horizon=441,
    props=(
        Prop(name="cube", solid=lambda: cube(BLACK)),
        chest("chest", body=WHITE, lid=CHARCOAL),
    ),
    placements={
        "cube": Placement(
            x=around(0.5, 0.175), y=around(0.2, 0.175), z=CUBE_EDGE / 2, yaw=ANY_YAW
        ),
        "chest": Placement(
            x=around(0.6, 0.04), y=around(-0.2, 0.04), yaw=around(0.0, math.radians(10))
        ),
    },
    stages=(
        Stage(
            name="the lid is open or the cube is lifted",
            instruction="Open the lid of the chest with one arm.",
            holds=_BEGUN,
            stays=_BEGUN | _LID.delivered,
        ),
        Stage(
            name="one arm holds the lid open and the other arm lifts the cube",
            instruction="Hold the lid open with one arm and pick up the black cube with the other.",
            holds=_LID.supported,
            stays=_LID.upheld,
        ),
        Stage(
            name="the cube lies in the chest",
            instruction="Lower the black cube into the chest and let go of it.",
            holds=placed(_INSIDE, rests_on("cube", "chest"), released("cube"))
            & _LID.delivered,
        ),
    ),
    expert="duobench.tasks.experts.scripts.hinge_chest:script",
    printable=True,
    real=True,
)
