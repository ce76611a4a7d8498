"""Transfer-Cube.

Task:
    One arm picks up the white block, which is three times as long as thick so that two grippers
    fit, and hands it to the other arm, which puts it into the bowl on its side of the table. (The
    paper calls the block a cube.)

Randomization:
    The block lies anywhere in the right half within 17.5 cm of its place at any yaw, the bowl
    within 5 cm of its place.

Success:
    The block has rested for half a second in the bowl, which stands on the table, and no gripper
    touches it. The arm that received it from the one that picked it up, in the air, has let it go
    there, at most 6 cm above the rim: neither dropped from on high nor thrown nor pushed.
"""

from duobench.core.randomness import ANY_YAW, around
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.handover import handover
from duobench.tasks.stages.logic import all_of
from duobench.tasks.stages.placing import placed
from duobench.tasks.stages.predicates import (
    CylinderRegion,
    inside,
    lifted_by_any,
    raised,
    released,
    rests_on,
)
from duobench.tasks.stages.progress import Stage
from duobench.tasks.stages.vessels import Vessel, stands_upright
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import (
    CUBE_EDGE,
    LONG_BLOCK,
    WHITE,
    long_block,
)
from duobench.world.objects.bowl import (
    FLOOR,
    RADIUS,
    RIM_HEIGHT,
    WALL,
    bowl,
)
from duobench.world.objects.prop import Prop

CUBE, BOWL = "cube", "bowl"
IN_BOWL = CylinderRegion(
    body=BOWL, radius=RADIUS - WALL, low=0.0, high=0.6 * LONG_BLOCK
)
"""Region of the block's centre when it lies, leans or stands in the bowl."""
BELOW_RIM = 0.020
"""The block's lowest point is less than this above the table, in metres: not on top of the rim."""

_CUBE = handover(CUBE, BOWL)
_BOWL = Vessel(
    body=BOWL,
    radius=RADIUS - WALL,
    rim=RIM_HEIGHT,
    floor=FLOOR,
)
_STAYS = _CUBE.stays(_BOWL.over(CUBE))

TASK = Task(
    id="transfer_cube",
    title="Transfer-Cube",
    category=Category.SEQUENTIAL_HANDOFF,
    instruction="Pick up the white block, hand it to the other arm in the air and lower it into "
    "the bowl.",
    paraphrases=paraphrases("transfer_cube"),
    kept_paraphrases=kept_paraphrases("transfer_cube"),
    horizon=441,
    props=(
        Prop(name=CUBE, solid=lambda: long_block(WHITE)),
        Prop(name=BOWL, solid=lambda: bowl(WHITE)),
    ),
    placements={
        CUBE: Placement(
            x=around(0.5, 0.175), y=around(-0.2, 0.175), z=CUBE_EDGE / 2, yaw=ANY_YAW
        ),
        BOWL: Placement(x=around(0.6, 0.05), y=around(0.3, 0.05)),
    },
    stages=(
        Stage(
            name="the white block is lifted",
            instruction="Pick up the white block.",
            holds=lifted_by_any(CUBE, BOWL),
            stays=_STAYS[0],
        ),
        Stage(
            name="both arms hold the white block in the air",
            instruction="Grasp the white block with the other arm as well, in the air.",
            holds=_CUBE.shared,
            stays=_STAYS[1],
        ),
        Stage(
            name="the other arm holds the white block",
            instruction="Let go of the white block with the arm that picked it up.",
            holds=_CUBE.handed_over,
            stays=_STAYS[2],
        ),
        Stage(
            name="the white block is in the bowl",
            instruction="Lower the white block into the bowl and let go.",
            holds=all_of(
                placed(
                    inside(CUBE, IN_BOWL),
                    rests_on(CUBE, BOWL),
                    ~raised(CUBE, BELOW_RIM),
                    released(CUBE),
                    stands_upright(_BOWL.body),
                ),
                _CUBE.put(_BOWL.over(CUBE)),
            ),
        ),
    ),
    expert="duobench.tasks.experts.scripts.transfer_cube:script",
    printable=True,
    real=True,
)
