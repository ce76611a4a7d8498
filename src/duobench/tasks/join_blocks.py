"""Join-Blocks.

Task:
    Two blocks, one in each arm, are plugged together, the light one's peg into a socket of the dark
    one; then the dark one's other socket goes onto the peg on a wall.

Randomization:
    Each block in its half of the table, within 5 x 7.5 cm of its place, turned by up to 15 degrees.

Success:
    For half a second the light block's peg has been in one socket of the dark block and the wall's
    peg in the other, both blocks let go and at rest.
"""

import math

from duobench.core.randomness import Uniform, around
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.insertion import Port, in_any_way, inserted
from duobench.tasks.stages.joining import engaged, joining
from duobench.tasks.stages.logic import all_of, any_of
from duobench.tasks.stages.placing import placed, put
from duobench.tasks.stages.predicates import (
    grasped_apart,
    off_table,
    released,
    still,
)
from duobench.tasks.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects import joint_blocks as bars
from duobench.world.objects.prop import Prop
from duobench.world.robot.cameras import View

DEPTH = 0.010
"""Least depth of an inserted peg, in metres [task definitions]."""
MAX_YAW = math.radians(15.0)
LIGHT = (0.86, 0.73, 0.53, 1.0)
DARK = (0.29, 0.19, 0.12, 1.0)
GREY = (0.55, 0.57, 0.60, 1.0)

_LIGHT_PEG = Port(body="light_block", pose=bars.LIGHT_TIP)
_WALL_PEG = Port(body="wall", pose=bars.WALL_TIP)
_FRONT = Port(body="dark_block", pose=bars.FRONT_MOUTH)
_BACK = Port(body="dark_block", pose=bars.BACK_MOUTH)
_BLOCKS = ("light_block", "dark_block")
_SOCKETS = ((_FRONT, _BACK), (_BACK, _FRONT))

_ON_WALL = in_any_way([(_WALL_PEG, _FRONT), (_WALL_PEG, _BACK)], engaged)
# One arm alone plugs a block into one that lies on the table or leans against the wall: what grips
# that one as well does nothing. In the air both arms are needed.
_LEANING = any_of(*(~off_table(block, "wall") for block in _BLOCKS))
_JOINING = joining(
    _LIGHT_PEG,
    (_FRONT, _BACK),
    DEPTH,
    unless=_ON_WALL | _LEANING,
)
_MOUNTED = any_of(
    *(
        inserted(_LIGHT_PEG, socket, DEPTH) & inserted(_WALL_PEG, free_socket, DEPTH)
        for socket, free_socket in _SOCKETS
    )
)
# A hand had one of them when the peg was in the socket; from there on it may push.
_PUT_ON = any_of(*(put(block, _ON_WALL) for block in _BLOCKS))
_LEFT_ALONE = all_of(*(still(block) & released(block) for block in _BLOCKS))
_YAW = Uniform(-MAX_YAW, MAX_YAW)

TASK = Task(
    id="join_blocks",
    title="Join-Blocks",
    category=Category.BIMANUAL_MANIPULATION,
    instruction=(
        "Plug the light block into the dark block in the air while each arm holds one of them, "
        "then push both onto the peg on the wall and let go."
    ),
    paraphrases=paraphrases("join_blocks"),
    kept_paraphrases=kept_paraphrases("join_blocks"),
    horizon=829,
    props=(
        Prop(
            name="light_block",
            solid=lambda: bars.light_bar(LIGHT),
            print_turn=bars.LIGHT_PRINT_TURN,
        ),
        Prop(
            name="dark_block",
            solid=lambda: bars.dark_bar(DARK),
            print_turn=bars.DARK_PRINT_TURN,
        ),
        Prop(
            name="wall",
            solid=lambda: bars.wall(GREY),
            fixed=True,
            print_turn=bars.WALL_PRINT_TURN,
        ),
    ),
    placements={
        "light_block": Placement(
            x=around(0.5, 0.05), y=around(0.2, 0.075), z=bars.BAR[2] / 2, yaw=_YAW
        ),
        "dark_block": Placement(
            x=around(0.5, 0.05), y=around(-0.2, 0.075), z=bars.BAR[2] / 2, yaw=_YAW
        ),
        "wall": Placement(x=around(0.7, 0.0), y=around(0.0, 0.0)),
    },
    stages=(
        Stage(
            name="both blocks are grasped",
            instruction="Grasp the light block with one arm and the dark block with the other.",
            holds=grasped_apart(*_BLOCKS),
            stays=grasped_apart(*_BLOCKS) | _JOINING.kept,
        ),
        Stage(
            name="the blocks are joined in the air",
            instruction=(
                "Plug the peg of the light block into a socket of the dark block in the air, while "
                "each arm holds its block."
            ),
            holds=_JOINING.joined,
            stays=_JOINING.kept,
        ),
        Stage(
            name="the joined blocks are on the wall",
            instruction=(
                "Push the free socket of the dark block onto the peg on the wall and let go of "
                "both blocks."
            ),
            holds=all_of(placed(_LEFT_ALONE, _MOUNTED), _JOINING.kept, _PUT_ON),
        ),
    ),
    # From beside the robot: the wall's peg points towards it.
    overview=View(eye=(0.25, -1.7, 1.15), target=(0.37, 0.0, 0.33), fovy_deg=39.0),
    expert="duobench.tasks.experts.scripts.join_blocks:script",
    printable=True,
)
