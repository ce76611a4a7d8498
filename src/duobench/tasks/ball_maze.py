"""Ball-Maze.

Task:
    A ball lies in a corner of a maze on a board. Both grippers lift the board by opposite grips and
    tilt it, so that the ball runs through the maze into the red corner.

Randomization:
    Board within 10 cm of its place at any yaw, with one of ten mazes.

Success:
    The ball is in the red corner of the lifted board, and got there by tilts alone.
"""

from __future__ import annotations

from math import inf

from duobench.randomness import ANY_YAW, Choice, around
from duobench.scene.naming import TABLE
from duobench.sim.layout import Layout
from duobench.solids.maze_board import (
    BALL_RADIUS,
    BASE,
    HALF,
    TOP,
    ball,
    board,
    cell_centre,
    wall_variants,
)
from duobench.solids.mazes import GOAL, MAZES, START, Cell
from duobench.solids.prop import Prop
from duobench.spatial import SE3
from duobench.stages.predicates import (
    BoxRegion,
    CylinderRegion,
    Predicate,
    all_of,
    any_of,
    grasped,
    inside,
    off_table,
    released,
    since,
    still,
    touching,
)
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.types import SIDES

LEFT_START, AT_GOAL = 0.020, 0.015
"""Distance in metres of the ball from the start's centre at least, and from the goal's at most."""
TAKEN = 0.005
"""How far the middle of a board that both arms have taken up is raised at least, in metres."""


def _ball_within(cell: Cell, radius: float) -> Predicate:
    """The ball is that near (metres, in the board's plane) to the centre of a cell."""
    return inside(
        "ball",
        CylinderRegion(body="board", radius=radius, low=0, high=TOP, centre=cell_centre(cell)),
    )


def _start_ball(layout: Layout) -> Layout:
    """The ball starts in the middle of its cell."""
    pose = layout.poses["board"] @ SE3.at(*cell_centre(START), BALL_RADIUS)
    return Layout(poses={**layout.poses, "ball": pose}, variants=layout.variants)


_ON_BOARD = inside("ball", BoxRegion(body="board", low=(-HALF, -HALF, 0), high=(HALF, HALF, TOP)))
_AT_START, _AT_GOAL = _ball_within(START, LEFT_START), _ball_within(GOAL, AT_GOAL)
_PINCHED = all_of(*(grasped(side, "board") for side in SIDES))
_OFF_TABLE = inside(
    "board", BoxRegion(body=TABLE, low=(-inf, -inf, BASE + TAKEN), high=(inf, inf, inf))
)
_LIFTED = all_of(_PINCHED, _OFF_TABLE, off_table("board"))
_TAKEN = all_of(_PINCHED, _OFF_TABLE, _AT_START)
# From the start to the goal the ball is moved by tilts of the lifted board alone. Where a finger
# touches it, or it moves while the board lies on the table, its way begins at the start again.
_SPOILT = any_of(~released("ball"), touching("board", TABLE) & ~_OFF_TABLE & ~still("ball"))
_ROLLED = all_of(_LIFTED, _ON_BOARD, ~_AT_START, released("ball"), since(_TAKEN, reset=_SPOILT))

TASK = Task(
    id="ball_maze",
    title="Ball-Maze",
    category=Category.BIMANUAL_MANIPULATION,
    instruction="Lift the maze with both hands and tilt it until the ball is in the red corner.",
    horizon=350,
    props=(
        Prop(name="board", solid=board(), choice="board", variants=wall_variants()),
        Prop(name="ball", solid=ball()),
    ),
    placements={"board": Placement(x=around(0.5, 0.1), y=around(0.0, 0.1), z=BASE, yaw=ANY_YAW)},
    variants={"board": Choice(tuple(str(number) for number in range(len(MAZES))))},
    arrange=_start_ball,
    stages=(
        Stage(
            name="a gripper touches the board",
            instruction="Reach for a grip of the board.",
            holds=~released("board"),
        ),
        Stage(
            name="both grippers hold the board",
            instruction="Grasp the board by two opposite grips.",
            holds=_PINCHED,
        ),
        Stage(
            name="the ball has left the start",
            instruction="Lift the board and tilt it, so that the ball leaves the start.",
            holds=_ROLLED,
        ),
        Stage(
            name="the ball is at the goal",
            instruction="Tilt the board until the ball is in the red corner.",
            holds=all_of(_LIFTED, _AT_GOAL, released("ball"), since(_ROLLED, reset=_SPOILT)),
        ),
    ),
    printable=True,
    real=True,
)
