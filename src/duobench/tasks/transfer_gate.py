"""Transfer-Gate.

Task:
    One arm picks up the white block and passes it through an upright ring to the other arm, which
    puts it down on the green mat.

Randomization:
    The block lies anywhere in the right half within 17.5 cm of its place at any yaw. The ring
    stands within 2.5 cm (away from the robot) and 5 cm (across) of its place, fixed to the table;
    the mat lies within 5 cm of its place. So the block goes through the ring from right to left.

Success:
    The block has rested on the mat for half a second, and no gripper touches it. The arm that put
    it down has received it in the air, on the far side or in the ring, from the arm that had
    brought it there. A receiver that reaches through the ring and takes it on the near side does
    not receive it through the ring.
"""

from duobench.core.randomness import ANY_YAW, around
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.handover import handover
from duobench.tasks.stages.logic import all_of, any_of
from duobench.tasks.stages.passage import Hole, passage
from duobench.tasks.stages.placing import low_over, placed
from duobench.tasks.stages.predicates import (
    BoxRegion,
    inside,
    lifted_by_any,
    released,
    rests_on,
)
from duobench.tasks.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import (
    CUBE_EDGE,
    LONG_BLOCK,
    WHITE,
    long_block,
)
from duobench.world.objects.gate import (
    MAT_EDGE,
    MAT_THICKNESS,
    RING_HEIGHT,
    RING_RADIUS,
    gate,
    mat,
)
from duobench.world.objects.prop import Prop

BLOCK, GATE, MAT = "block", "gate", "mat"
CROSSING_RADIUS = 0.10
"""Largest distance in metres of the block's centre from the ring's [task definitions]."""
OVER_MAT = BoxRegion(
    body=MAT,
    low=(-MAT_EDGE / 2, -MAT_EDGE / 2, 0.0),
    high=(MAT_EDGE / 2, MAT_EDGE / 2, LONG_BLOCK),
)

_HELD = lifted_by_any(BLOCK, MAT)
_WAY = passage(
    BLOCK,
    Hole(
        body=GATE,
        height=RING_HEIGHT,
        radius=CROSSING_RADIUS,
        rim=RING_RADIUS,
    ),
    length=LONG_BLOCK,
    held=_HELD,
)
_BLOCK = handover(BLOCK, MAT, way=_WAY, top=MAT_THICKNESS)
_OVER_MAT = inside(BLOCK, OVER_MAT)
_AT_MAT = _OVER_MAT & low_over(BLOCK, MAT, MAT_THICKNESS / 2)
_STAYS = _BLOCK.stays(_AT_MAT)

TASK = Task(
    id="transfer_gate",
    title="Transfer-Gate",
    category=Category.SEQUENTIAL_HANDOFF,
    instruction="Pick up the white block, hand it to the other arm in the air, through the ring, "
    "and put it down on the green mat.",
    paraphrases=paraphrases("transfer_gate"),
    kept_paraphrases=kept_paraphrases("transfer_gate"),
    horizon=523,
    props=(
        Prop(name=BLOCK, solid=lambda: long_block(WHITE)),
        Prop(name=GATE, solid=gate, fixed=True),
        Prop(name=MAT, solid=mat, fixed=True),
    ),
    placements={
        BLOCK: Placement(
            x=around(0.5, 0.175), y=around(-0.3, 0.175), z=CUBE_EDGE / 2, yaw=ANY_YAW
        ),
        GATE: Placement(x=around(0.4, 0.025), y=around(0.0, 0.05)),
        MAT: Placement(x=around(0.5, 0.05), y=around(0.3, 0.05), z=MAT_THICKNESS / 2),
    },
    stages=(
        Stage(
            name="the white block is lifted",
            instruction="Pick up the white block.",
            holds=_HELD,
            stays=_STAYS[0],
        ),
        Stage(
            name="the white block has crossed the ring",
            instruction="Bring the white block through the ring.",
            holds=_WAY.crossing,
            stays=any_of(*_BLOCK.giver.values(), _STAYS[2]),
        ),
        Stage(
            name="the other arm holds the white block",
            instruction=(
                "Hand the white block to the other arm in the air, on the far side of the ring."
            ),
            holds=_BLOCK.handed_over,
            stays=_STAYS[2],
        ),
        Stage(
            name="the white block is on the green mat",
            instruction="Put the white block down on the green mat and let go.",
            holds=all_of(
                placed(rests_on(BLOCK, MAT), _OVER_MAT, released(BLOCK)),
                _BLOCK.put(_AT_MAT),
            ),
        ),
    ),
    expert="duobench.tasks.experts.scripts.transfer_gate:script",
    printable=True,
)
