"""Ball-Maze.

Task:
    A ball lies in a corner of a maze on a board. Both arms lift the board and tilt it, so that
    the ball rolls through the maze into the red corner.

Randomization:
    Board within 10 cm of its place at any yaw, with one of ten mazes. The ball's corner and the red
    one are others on every board.

Success:
    The ball rests in the red corner of the lifted board, and rolled there by tilts alone.
"""

from collections.abc import Iterable
from functools import partial
from math import inf

from duobench.core.randomness import ANY_YAW, Choice, around
from duobench.core.spatial import SE3
from duobench.core.types import SIDES
from duobench.tasks.object_state import (
    maze_of,
    pose,
    position,
    velocity,
)
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.logic import Predicate, all_of
from duobench.tasks.stages.predicates import (
    BoxRegion,
    CylinderRegion,
    grasped,
    inside,
    off_table,
    released,
)
from duobench.tasks.stages.progress import Stage
from duobench.tasks.stages.rolling import inside_chosen, rolling
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.maze_board import (
    BALL_RADIUS,
    BASE,
    HALF,
    WALL_HEIGHT,
    ball,
    board,
    cell_centre,
    wall_variants,
)
from duobench.world.objects.mazes import CELLS, MAZES, Cell
from duobench.world.objects.prop import Prop
from duobench.world.scene.naming import TABLE
from duobench.world.sim.layout import Layout

LEFT_START, AT_GOAL = 0.020, 0.015
"""Distance in metres of the ball from the start's centre at least, and from the goal's at most."""
RAISE = 0.010
"""Least height in metres by which the middle of a lifted board is raised."""


def _near(cells: Iterable[Cell], radius: float) -> Predicate:
    """The ball is near (metres, in the board's plane) to the centre of its board's cell."""
    region = partial(
        CylinderRegion, body="board", radius=radius, low=0, high=WALL_HEIGHT
    )
    regions = {str(n): region(centre=cell_centre(cell)) for n, cell in enumerate(cells)}
    return inside_chosen("ball", "board", regions)


def _start_ball(layout: Layout) -> Layout:
    """The ball starts in the middle of its cell."""
    start = MAZES[int(layout.variants["board"])].start
    pose = layout.poses["board"] @ SE3.at(*cell_centre(start), BALL_RADIUS)
    return Layout(poses={**layout.poses, "ball": pose}, variants=layout.variants)


_HIGH = BoxRegion(body=TABLE, low=(-inf, -inf, BASE + RAISE), high=(inf, inf, inf))
_GRASPED = all_of(*(grasped(side, "board") for side in SIDES))
_ROLLING = rolling(
    "ball",
    BoxRegion(body="board", low=(-HALF, -HALF, 0), high=(HALF, HALF, WALL_HEIGHT)),
    cells=CELLS,
    at_start=_near((maze.start for maze in MAZES), LEFT_START),
    at_goal=_near((maze.goal for maze in MAZES), AT_GOAL),
    in_air=inside("board", _HIGH) & off_table("board"),
)

TASK = Task(
    id="ball_maze",
    title="Ball-Maze",
    category=Category.BIMANUAL_MANIPULATION,
    instruction="Lift the board with both arms and tilt it until the ball is in the red corner.",
    paraphrases=paraphrases("ball_maze"),
    kept_paraphrases=kept_paraphrases("ball_maze"),
    horizon=350,
    props=(
        Prop(
            name="board",
            solid=board,
            choice="board",
            variants=wall_variants,
        ),
        Prop(name="ball", solid=ball),
    ),
    placements={
        "board": Placement(
            x=around(0.5, 0.1),
            y=around(0.0, 0.1),
            z=BASE,
            yaw=ANY_YAW,
        )
    },
    variants={"board": Choice(tuple(str(number) for number in range(len(MAZES))))},
    arrange=_start_ball,
    stages=(
        Stage(
            name="an arm touches the board",
            instruction="Touch the board with one arm.",
            holds=~released("board"),
            stays=~released("board"),
        ),
        Stage(
            name="both arms grasp the board",
            instruction="Grasp the board with both arms.",
            holds=_GRASPED,
            stays=_GRASPED,
        ),
        Stage(
            name="the ball has left the start",
            instruction=(
                "Lift the board with the ball in the green corner and tilt it, so that the ball "
                "rolls out of that corner."
            ),
            holds=_ROLLING.left,
            stays=_ROLLING.underway,
        ),
        Stage(
            name="the ball rests at the goal",
            instruction="Hold the board up and tilt it until the ball stays in the red corner.",
            holds=_ROLLING.arrived,
        ),
    ),
    object_numbers=(
        pose("board"),
        position("ball"),
        velocity("ball"),
        maze_of("board"),
    ),
    expert="duobench.tasks.experts.scripts.ball_maze:script",
    printable=True,
    real=True,
)
