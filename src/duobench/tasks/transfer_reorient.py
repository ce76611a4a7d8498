"""Transfer-Reorient.

Task:
    One arm picks up a lying hexagonal peg and hands it to the other arm, which turns it upright and
    inserts it into the one of three holes that has its shape.

Randomization:
    The peg lies anywhere within 15 cm of its place on the right, turned by up to 30 degrees. The
    board lies within 10 cm of its place on the left and does not move.

Success:
    The peg has been at rest at least 15 mm deep in the hexagonal hole for half a second, and no
    gripper touches it. The arm that received it from the one that picked it up, in the air, let it
    go with its tip in the hole, or at most a little above and beside it.
"""

import math
from functools import partial

import numpy as np

from duobench.core.randomness import Uniform, around
from duobench.core.spatial import SE3
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.handover import handover
from duobench.tasks.stages.insertion import Port, in_any_way, inserted
from duobench.tasks.stages.joining import engaged
from duobench.tasks.stages.placing import PUT_HEIGHT, placed
from duobench.tasks.stages.predicates import lifted_by_any, released, still
from duobench.tasks.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import WHITE
from duobench.world.objects.hexagon_peg import (
    ACROSS_FLATS,
    BOARD_HEIGHT,
    HEXAGON,
    PEG_LENGTH,
    PEG_PRINT_TURN,
    peg,
    socket_board,
)
from duobench.world.objects.prop import Prop

PEG, BOARD = "peg", "board"
DEPTH = 0.015
"""Least depth of the inserted peg in metres."""
MAX_YAW = math.radians(30)
BLUE = (0.12, 0.33, 0.70, 1.0)

TIPS = tuple(
    Port(
        body=PEG,
        pose=SE3(
            SE3.about((0, 1, 0), end * math.pi / 2).rotation, np.array([x, 0.0, 0.0])
        ),
    )
    for end, x in ((1, PEG_LENGTH / 2), (-1, -PEG_LENGTH / 2))
)
"""Either end of the peg."""
MOUTH = Port(body=BOARD, pose=SE3.at(HEXAGON.x, 0.0, BOARD_HEIGHT))

_PEG = handover(PEG, BOARD)
_WAYS = [(tip, MOUTH) for tip in TIPS]
_IN_HOLE = in_any_way(_WAYS, partial(inserted, depth=DEPTH))
_TIP_AT_HOLE = in_any_way(_WAYS, partial(engaged, depth=-PUT_HEIGHT))
_STAYS = _PEG.stays(_TIP_AT_HOLE)

TASK = Task(
    id="transfer_reorient",
    title="Transfer-Reorient",
    category=Category.SEQUENTIAL_HANDOFF,
    instruction="Pick up the peg, hand it to the other arm in the air and insert it upright into "
    "the hexagonal hole.",
    paraphrases=paraphrases("transfer_reorient"),
    kept_paraphrases=kept_paraphrases("transfer_reorient"),
    horizon=505,
    props=(
        Prop(name=PEG, solid=lambda: peg(BLUE), print_turn=PEG_PRINT_TURN),
        Prop(name=BOARD, solid=lambda: socket_board(WHITE), fixed=True),
    ),
    placements={
        PEG: Placement(
            x=around(0.5, 0.15),
            y=around(-0.2, 0.15),
            z=ACROSS_FLATS / 2,
            yaw=Uniform(-MAX_YAW, MAX_YAW),
        ),
        BOARD: Placement(x=around(0.5, 0.10), y=around(0.3, 0.10)),
    },
    stages=(
        Stage(
            name="the peg is lifted",
            instruction="Pick up the peg.",
            holds=lifted_by_any(PEG, BOARD),
            stays=_STAYS[0],
        ),
        Stage(
            name="both arms hold the peg in the air",
            instruction="Grasp the peg with the other arm as well, in the air.",
            holds=_PEG.shared,
            stays=_STAYS[1],
        ),
        Stage(
            name="the other arm holds the peg",
            instruction="Let go of the peg with the arm that picked it up.",
            holds=_PEG.handed_over,
            stays=_STAYS[2],
        ),
        Stage(
            name="the peg is in the hexagonal hole",
            instruction="Insert the peg upright into the hexagonal hole and let go.",
            holds=placed(_IN_HOLE, still(PEG), released(PEG)) & _PEG.put(_TIP_AT_HOLE),
        ),
    ),
    expert="duobench.tasks.experts.scripts.transfer_reorient:script",
    printable=True,
)
