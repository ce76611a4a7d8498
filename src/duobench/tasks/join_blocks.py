"""Join-Blocks.

Task:
    Two bars are plugged together in the air, the light one's peg into a socket of the dark one;
    then the dark one's other socket goes onto the peg of a wall.

Randomization:
    Each bar in its half of the table, within 5 x 7.5 cm of its place, turned by up to 15 degrees.

Success:
    The light bar's peg is in one socket of the dark bar and the wall's peg in the other.
"""

from __future__ import annotations

import math

from duobench.randomness import Uniform, around
from duobench.scene.cameras import View
from duobench.solids import joint_blocks as bars
from duobench.solids.prop import Prop
from duobench.stages.insertion import Port, inserted
from duobench.stages.predicates import all_of, any_of, grasped_apart, since
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task

DEPTH = 0.010
"""How deep a peg is inserted at least, in metres [task definitions]."""
MAX_YAW = math.radians(15.0)
LIGHT = (0.86, 0.73, 0.53, 1.0)
DARK = (0.29, 0.19, 0.12, 1.0)
GREY = (0.55, 0.57, 0.60, 1.0)

_LIGHT_PEG = Port(body="light_block", pose=bars.LIGHT_TIP)
_WALL_PEG = Port(body="wall", pose=bars.WALL_TIP)
_FRONT = Port(body="dark_block", pose=bars.FRONT_MOUTH)
_BACK = Port(body="dark_block", pose=bars.BACK_MOUTH)
_SOCKETS = ((_FRONT, _BACK), (_BACK, _FRONT))

_BOTH_PINCHED = grasped_apart("light_block", "dark_block")
_JOINED = all_of(
    any_of(*(inserted(_LIGHT_PEG, socket, DEPTH) for socket, _ in _SOCKETS)), since(_BOTH_PINCHED)
)
_MOUNTED = all_of(
    any_of(
        *(
            inserted(_LIGHT_PEG, socket, DEPTH) & inserted(_WALL_PEG, free_socket, DEPTH)
            for socket, free_socket in _SOCKETS
        )
    ),
    since(_JOINED),
)
_YAW = Uniform(-MAX_YAW, MAX_YAW)

TASK = Task(
    id="join_blocks",
    title="Join-Blocks",
    category=Category.BIMANUAL_MANIPULATION,
    instruction=(
        "Plug the light block into the dark block, then push both onto the peg of the wall."
    ),
    horizon=829,
    props=(
        Prop(name="light_block", solid=bars.light_bar(LIGHT)),
        Prop(name="dark_block", solid=bars.dark_bar(DARK)),
        Prop(name="wall", solid=bars.wall(GREY), fixed=True),
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
            instruction="Take one block with each hand.",
            holds=_BOTH_PINCHED,
        ),
        Stage(
            name="the blocks are joined",
            instruction="Plug the peg of the light block into a socket of the dark block.",
            holds=_JOINED,
        ),
        Stage(
            name="the joined blocks are on the wall",
            instruction="Push the free socket of the dark block onto the peg of the wall.",
            holds=_MOUNTED,
        ),
    ),
    # From beside the robot: the wall's peg points towards it.
    overview=View(eye=(0.25, -1.7, 1.15), target=(0.37, 0.0, 0.33), fovy_deg=39.0),
    printable=True,
)
