"""Mug-on-Coaster, a task with an object from a file.

Task: A mug goes onto a coaster.
Randomization: The mug within 8 cm of its place, its handle at any angle; the coaster within 5 cm.
Success: The mug stands on the coaster, where it was put, and no gripper touches it.
"""

import math

from duobench.tasks import (
    ANY_YAW,
    WOOD,
    Category,
    Placement,
    Prop,
    Side,
    Solid,
    Stage,
    Task,
    around,
    cylinder,
    lifted_by_any,
    low_over,
    mesh_object,
    placed,
    put,
    released,
    rests_on,
    upright,
)
from duobench.tasks.experts.handling import pick, place
from duobench.tasks.experts.motion import Arms, Script, down, nearest_turn

HANDLE = 0.01175
"""Distance of the mug's axis from the middle of the box around mug and handle, in metres."""
THICK = 0.008
"""Of the coaster, in metres."""
COASTER = Solid(shapes=(cylinder(0.055, THICK),), rgba=WOOD)

TASK = Task(
    id="mug_on_coaster",
    title="Mug-on-Coaster",
    category=Category.PARALLEL_EXECUTION,
    instruction="Put the mug on the coaster.",
    horizon=300,
    props=(
        mesh_object("mug.stl", mass=0.15, units="mm", rgba=(0.16, 0.34, 0.55, 1.0)),
        Prop(name="coaster", solid=COASTER, fixed=True),
    ),
    placements={
        "mug": Placement(x=around(0.5, 0.08), y=around(0.2, 0.08), yaw=ANY_YAW),
        "coaster": Placement(x=around(0.5, 0.05), y=around(-0.05, 0.05), z=THICK / 2),
    },
    stages=(
        Stage(
            name="the mug is lifted",
            instruction="Pick up the mug.",
            holds=lifted_by_any("mug"),
        ),
        Stage(
            name="the mug stands on the coaster",
            instruction="Put it on the coaster and let go.",
            holds=placed(
                rests_on("mug", "coaster"),
                upright("mug", math.radians(10.0)),
                released("mug"),
            )
            & put("mug", low_over("mug", "coaster", THICK / 2)),
        ),
    ),
    printable=True,
    expert="mug_on_coaster:script",
)


def script(arms: Arms) -> Script:
    """Grasp the mug across its handle, and put it down in the middle of the coaster."""
    mug, coaster = arms.sim.pose("mug"), arms.sim.pose("coaster")
    x, y, _ = mug.apply((-HANDLE, 0.0, 0.0))
    turn = nearest_turn(mug.yaw, math.pi)
    yield from pick(arms, Side.LEFT, down(x, y, 0.055, yaw=turn))
    x, y, _ = coaster.translation
    yield from place(arms, Side.LEFT, down(x, y, 0.055 + THICK + 0.003, yaw=0.0))
