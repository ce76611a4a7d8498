"""Bin-Sort.

Task:
    Two cubes, a black and a white one, go into the bowl of their colour. Either arm may take
    either cube; nothing couples the arms.

Randomization:
    Each cube anywhere in its half of the table at any yaw, each bowl within 5 cm of its place.

Success:
    Both cubes lie in the bowls of their colours and no gripper touches them.
"""

from __future__ import annotations

from duobench.randomness import ANY_YAW, around
from duobench.sim.layout import Layout
from duobench.solids.blocks import BLACK, CHARCOAL, CUBE_EDGE, PALE, WHITE, cube
from duobench.solids.bowl import RADIUS, RIM_HEIGHT, WALL, bowl
from duobench.solids.prop import Prop
from duobench.stages.predicates import (
    CylinderRegion,
    Predicate,
    all_of,
    any_of,
    inside,
    lifted_by_any,
    off_table,
    released,
    touching,
)
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task

COLOURS = ("white", "black")
BOWL_MARGIN = 0.10
"""Least distance between a cube's centre and a bowl's rim at the start, in metres."""


def _cube(colour: str) -> str:
    return f"{colour}_cube"


def _bowl(colour: str) -> str:
    return f"{colour}_bowl"


def _apart(layout: Layout) -> bool:
    """No cube starts in or under a bowl's rim."""
    return all(
        layout.poses[_cube(one)].distance(layout.poses[_bowl(other)])[0] > RADIUS + BOWL_MARGIN
        for one in COLOURS
        for other in COLOURS
    )


def _in_bowl(colour: str) -> Predicate:
    """The cube is in the bowl of its colour, which stands under it."""
    cube_name, bowl_name = _cube(colour), _bowl(colour)
    region = CylinderRegion(body=bowl_name, radius=RADIUS - WALL, low=0.0, high=RIM_HEIGHT)
    return all_of(touching(cube_name, bowl_name), inside(cube_name, region), off_table(cube_name))


_REACHED = {colour: _in_bowl(colour) for colour in COLOURS}
_WHITE_IN, _BLACK_IN = (_REACHED[colour] & released(_cube(colour)) for colour in COLOURS)
_WHITE_HELD, _BLACK_HELD = (lifted_by_any(_cube(colour)) for colour in COLOURS)

TASK = Task(
    id="bin_sort",
    title="Bin-Sort",
    category=Category.PARALLEL_EXECUTION,
    instruction="Put the white cube into the white bowl and the black cube into the black bowl.",
    horizon=216,
    props=(
        Prop(name="white_cube", solid=cube(WHITE)),
        Prop(name="black_cube", solid=cube(BLACK)),
        Prop(name="white_bowl", solid=bowl(WHITE)),
        Prop(name="black_bowl", solid=bowl(CHARCOAL, rim=PALE)),
    ),
    placements={
        "white_cube": Placement(
            x=around(0.5, 0.175), y=around(0.2, 0.125), z=CUBE_EDGE / 2, yaw=ANY_YAW
        ),
        "black_cube": Placement(
            x=around(0.5, 0.175), y=around(-0.2, 0.125), z=CUBE_EDGE / 2, yaw=ANY_YAW
        ),
        "white_bowl": Placement(x=around(0.6, 0.05), y=around(0.4, 0.05)),
        "black_bowl": Placement(x=around(0.6, 0.05), y=around(-0.4, 0.05)),
    },
    accept=_apart,
    stages=(
        Stage(
            name="a cube is held",
            instruction="Pick up a cube.",
            holds=_WHITE_HELD | _BLACK_HELD,
        ),
        Stage(
            name="both cubes are held, or one is in its bowl",
            instruction="Pick up the other cube or put the held one into its bowl.",
            holds=any_of(_WHITE_HELD & _BLACK_HELD, *_REACHED.values()),
        ),
        Stage(
            name="one cube is in its bowl",
            instruction="Put a cube into the bowl of its colour and let go.",
            holds=_WHITE_IN | _BLACK_IN,
        ),
        Stage(
            name="one cube is in its bowl, the other is held",
            instruction="Pick up the other cube.",
            holds=any_of(_WHITE_IN & _BLACK_HELD, _BLACK_IN & _WHITE_HELD),
        ),
        Stage(
            name="both cubes are in their bowls",
            instruction="Put the other cube into the bowl of its colour and let go.",
            holds=_WHITE_IN & _BLACK_IN,
        ),
    ),
    printable=True,
    real=True,
)
