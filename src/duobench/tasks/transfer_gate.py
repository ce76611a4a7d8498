"""Transfer-Gate.

Task:
    The right arm picks up the block and passes it through an upright ring to the left arm, which
    puts it down on the mat.

Randomization:
    The block lies anywhere in the right half within 17.5 cm of its place at any yaw. The ring
    stands within 2.5 cm (away from the robot) and 5 cm (across) of its place, the mat lies within
    5 cm of its place.

Success:
    The block rests on the mat and no gripper touches it. The left arm has received it on the left
    of the ring, through the ring, and let go only when the block had touched the mat.
"""

from __future__ import annotations

from duobench.randomness import ANY_YAW, around
from duobench.solids.blocks import CUBE_EDGE, LONG_BLOCK, WHITE, long_block
from duobench.solids.gate import MAT_EDGE, MAT_THICKNESS, RING_HEIGHT, gate, mat
from duobench.solids.prop import Prop
from duobench.stages.handover import handover
from duobench.stages.passage import Hole, passage
from duobench.stages.predicates import (
    LIFTED_HEIGHT,
    BoxRegion,
    all_of,
    grasped,
    inside,
    lifted_by_any,
    off_table,
    raised,
    released,
    rests_on,
    since,
    touching,
)
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.types import Side

BLOCK, GATE, MAT = "block", "gate", "mat"
CROSSING_RADIUS = 0.10
"""How far from the ring's centre the block's centre may cross, in metres."""
OVER_MAT = BoxRegion(
    body=MAT,
    low=(-MAT_EDGE / 2, -MAT_EDGE / 2, 0.0),
    high=(MAT_EDGE / 2, MAT_EDGE / 2, LONG_BLOCK),
)

_WAY = passage(BLOCK, Hole(body=GATE, height=RING_HEIGHT, radius=CROSSING_RADIUS))
_BLOCK = handover(BLOCK, MAT, where=_WAY.through)
_RECEIVED = _BLOCK.received[Side.LEFT] & _WAY.through
_PUT_DOWN = touching(BLOCK, MAT) & grasped(Side.LEFT, BLOCK) & since(_RECEIVED)
_TAKEN_UP = raised(BLOCK, MAT_THICKNESS + LIFTED_HEIGHT)

TASK = Task(
    id="transfer_gate",
    title="Transfer-Gate",
    category=Category.SEQUENTIAL_HANDOFF,
    instruction="Pick up the block, hand it to the other arm through the ring and put it down on "
    "the green mat.",
    horizon=523,
    props=(
        Prop(name=BLOCK, solid=long_block(WHITE)),
        Prop(name=GATE, solid=gate()),
        Prop(name=MAT, solid=mat(), fixed=True),
    ),
    placements={
        BLOCK: Placement(x=around(0.5, 0.175), y=around(-0.3, 0.175), z=CUBE_EDGE / 2, yaw=ANY_YAW),
        GATE: Placement(x=around(0.4, 0.025), y=around(0.0, 0.05)),
        MAT: Placement(x=around(0.5, 0.05), y=around(0.3, 0.05), z=MAT_THICKNESS / 2),
    },
    stages=(
        Stage(
            name="the block is held",
            instruction="Pick up the block.",
            holds=lifted_by_any(BLOCK, MAT),
        ),
        Stage(
            name="the block has crossed the ring",
            instruction="Bring the block through the ring.",
            holds=_WAY.crossing & off_table(BLOCK),
        ),
        Stage(
            name="the other arm holds the block",
            instruction="Let the other arm take the block behind the ring.",
            holds=_RECEIVED,
        ),
        Stage(
            name="the block is on the mat",
            instruction="Put the block down on the green mat and let go.",
            holds=all_of(
                rests_on(BLOCK, MAT),
                inside(BLOCK, OVER_MAT),
                released(BLOCK),
                _BLOCK.delivered[Side.LEFT],
                since(_PUT_DOWN, reset=_TAKEN_UP),
            ),
        ),
    ),
    printable=True,
)
