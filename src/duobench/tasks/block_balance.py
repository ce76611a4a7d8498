"""Block-Balance.

Task:
    A beam goes across a small red cube, and two blocks onto the ends of the beam. One block alone
    tips the beam, so both arms must put theirs down together.

Randomization:
    Beam and cube in front of each other near the middle, one block in each half, all within a few
    centimetres of their places, without yaw.

Success:
    Both blocks stand on the ends of the level beam, the beam on the cube, all released and still
    for half a second.
"""

from __future__ import annotations

import math

from duobench.randomness import around
from duobench.solids.blocks import RED, WOOD, YELLOW, block
from duobench.solids.prop import Prop
from duobench.stages import predicates as is_
from duobench.stages.predicates import all_of, any_of, off_table, since, touching
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task

CUBE_EDGE = 0.040
BEAM = (0.040, 0.200, 0.020)
"""The beam lies along y: width, length, height in metres."""
BLOCK = (0.030, 0.030, 0.090)
"""A block stands upright."""
TIPPING = CUBE_EDGE / 2 * (1 + math.prod(BEAM) / math.prod(BLOCK))
"""Distance in metres from the beam's middle from which on a block alone tips it over the cube's
edge (60 mm), all of one density: the ends of the beam, where both are needed, begin there."""
ENDS = tuple(
    is_.BoxRegion(body="beam", low=(-BEAM[0] / 2, low, 0), high=(BEAM[0] / 2, high, BLOCK[2]))
    for low, high in ((-BEAM[1] / 2, -TIPPING), (TIPPING, BEAM[1] / 2))
)
LEVEL = math.radians(12.0)
STILL_SECONDS = 0.5
"""How long everything must stand still [task definitions]."""
BLOCKS = ("left_block", "right_block")

_ON_CUBE = touching("beam", "cube") & off_table("beam")
_LEVEL = is_.upright("beam", LEVEL)
_EVERYTHING = ("cube", "beam", *BLOCKS)
# A block is on either end of the beam, and the table carries neither.
_ON_BEAM = all_of(
    *(any_of(*(is_.inside(name, end) for name in BLOCKS)) for end in ENDS),
    *(touching(name, "beam") & off_table(name) for name in BLOCKS),
)
_HELD = is_.lifted_by_any("beam")
_BRIDGE = all_of(is_.rests_on("beam", "cube"), _LEVEL, since(_HELD))
_READY = all_of(is_.grasped_apart(*BLOCKS), _ON_CUBE, since(_BRIDGE))
_LOADED = all_of(_ON_BEAM, _ON_CUBE, since(_READY))
_RELEASED = all_of(*(is_.still(name) & is_.released(name) for name in _EVERYTHING))
_BALANCED = is_.held_for(all_of(_ON_BEAM, _ON_CUBE, _LEVEL, _RELEASED), STILL_SECONDS) & since(
    _LOADED
)

TASK = Task(
    id="block_balance",
    title="Block-Balance",
    category=Category.BIMANUAL_MANIPULATION,
    instruction=(
        "Put the beam across the red cube, then put both blocks onto its ends at the same time, "
        "so that it stays balanced."
    ),
    horizon=766,
    props=(
        Prop(name="cube", solid=block(CUBE_EDGE, CUBE_EDGE, CUBE_EDGE, RED)),
        Prop(name="beam", solid=block(*BEAM, WOOD)),
        *(Prop(name=name, solid=block(*BLOCK, YELLOW)) for name in BLOCKS),
    ),
    # The beam is 8 cm or more in front of the cube, nearer to the robot, so that neither hides the
    # other from the head camera and no yaw is needed to bring it across.
    placements={
        "cube": Placement(x=around(0.58, 0.03), y=around(0.0, 0.04), z=CUBE_EDGE / 2),
        "beam": Placement(x=around(0.44, 0.03), y=around(0.0, 0.03), z=BEAM[2] / 2),
        "left_block": Placement(x=around(0.5, 0.05), y=around(0.24, 0.04), z=BLOCK[2] / 2),
        "right_block": Placement(x=around(0.5, 0.05), y=around(-0.24, 0.04), z=BLOCK[2] / 2),
    },
    stages=(
        Stage(name="the beam is held", instruction="Pick up the beam.", holds=_HELD),
        Stage(
            name="the beam rests on the cube",
            instruction="Put the middle of the beam on the red cube.",
            holds=_BRIDGE,
        ),
        Stage(
            name="both blocks are grasped",
            instruction="Take one block with each hand.",
            holds=_READY,
        ),
        Stage(
            name="both blocks are on the beam",
            instruction="Put both blocks onto the ends of the beam at the same time.",
            holds=_LOADED,
        ),
        Stage(
            name="everything is balanced",
            instruction="Let go of both blocks and move away.",
            holds=_BALANCED,
        ),
    ),
    printable=True,
)
