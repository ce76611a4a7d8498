"""Spring-Door.

Task:
    A cube goes into a microwave whose door swings shut by itself: one arm pulls the door open, by
    its handle for example, and supports it while the other arm puts the cube inside.

Randomization:
    The cube within 5 cm by 10 cm of its place on the right at any yaw, the microwave within 2 cm
    and 3 degrees of its place.

Success:
    The cube has rested on the floor of the cavity for half a second, clear of the door, and no
    gripper touches it. The arm that brought it let it go at most 6 cm above the floor, and the
    other arm supported the door until it was inside.
"""

import math
from dataclasses import replace
from math import inf

from duobench.core.randomness import ANY_YAW, around
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.logic import all_of
from duobench.tasks.stages.placing import (
    DROP_HEIGHT,
    lifted_off,
    low_over,
    placed,
)
from duobench.tasks.stages.predicates import (
    BoxRegion,
    hinge_open,
    inside,
    lifted_by_any,
    released,
    rests_on,
    touching,
)
from duobench.tasks.stages.progress import Stage
from duobench.tasks.stages.support import support
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import CUBE_EDGE, WHITE, cube
from duobench.world.objects.microwave import (
    CAVITY,
    CAVITY_CENTRE_Y,
    FLOOR,
    FRONT,
    microwave,
)
from duobench.world.objects.prop import Prop
from duobench.world.robot.cameras import View

OPEN_ANGLE = 0.8
"""Angle in radians from which on the door counts as open."""
FLOOR_REGION = BoxRegion(
    body="microwave",
    low=(FRONT + CUBE_EDGE / 2, CAVITY_CENTRE_Y - CAVITY[1] / 2, FLOOR),
    high=(FRONT + CAVITY[0], CAVITY_CENTRE_Y + CAVITY[1] / 2, FLOOR + CUBE_EDGE),
)
"""Region of the cube's centre when the cube lies on the cavity's floor, behind the front."""

_INSIDE = inside("cube", FLOOR_REGION)
_ON_SILL = (FLOOR_REGION.low[0] - CUBE_EDGE, *FLOOR_REGION.low[1:])
"""A hand under the roof may set the cube on the sill, half outside, and push it in."""
_OVER = inside(
    "cube", replace(FLOOR_REGION, low=_ON_SILL, high=(*FLOOR_REGION.high[:2], inf))
)
_DOOR = support(
    "cube",
    "microwave",
    "microwave/door",
    OPEN_ANGLE,
    goal=_INSIDE,
    there=_OVER & low_over("cube", "microwave", FLOOR, DROP_HEIGHT),
    again=lifted_off("cube", "microwave", FLOOR),
)
_AT_REST = all_of(rests_on("cube", "microwave"), ~touching("cube", "microwave/door"))
_LIFTED = lifted_by_any("cube", "microwave", "microwave/door")
_BEGUN = hinge_open("microwave/door", OPEN_ANGLE) | _LIFTED

TASK = Task(
    id="spring_door",
    title="Spring-Door",
    category=Category.ASYMMETRIC_SUPPORT,
    instruction=(
        "Hold the door of the microwave open with one arm and put the white cube inside with the "
        "other."
    ),
    paraphrases=paraphrases("spring_door"),
    kept_paraphrases=kept_paraphrases("spring_door"),
    horizon=807,
    props=(
        Prop(name="cube", solid=lambda: cube(WHITE)),
        microwave("microwave"),
    ),
    placements={
        "cube": Placement(
            x=around(0.4, 0.05), y=around(-0.35, 0.1), z=CUBE_EDGE / 2, yaw=ANY_YAW
        ),
        "microwave": Placement(
            x=around(0.7, 0.02), y=around(0.0, 0.02), yaw=around(0.0, math.radians(3))
        ),
    },
    stages=(
        Stage(
            name="the door is open or the cube is lifted",
            instruction="Open the door of the microwave with one arm.",
            holds=_BEGUN,
            stays=_BEGUN | _DOOR.delivered,
        ),
        Stage(
            name="one arm holds the door open and the other arm lifts the cube",
            instruction=(
                "Hold the door open with one arm and pick up the white cube with the other."
            ),
            holds=_DOOR.supported,
            stays=_DOOR.upheld,
        ),
        Stage(
            name="the cube lies in the microwave",
            instruction="Put the white cube on the floor of the microwave and let go of it.",
            holds=placed(_INSIDE, _AT_REST, released("cube")) & _DOOR.delivered,
        ),
    ),
    # From beside the robot: the microwave faces it.
    overview=View(eye=(0.05, -1.85, 1.3), target=(0.38, -0.02, 0.32), fovy_deg=39.0),
    expert="duobench.tasks.experts.scripts.spring_door:script",
)
