"""How one might cheat in ball_maze."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import islice

import numpy as np

from duobench.experts.handling import carry, come_down
from duobench.experts.motion import Arms, Script, down, grip, move, nearest_turn, release, wait
from duobench.experts.scripts.ball_maze import grasp, grip_poses, lift, script, solve
from duobench.objects.maze_board import BALL_RADIUS, BASE, PITCH, WALL_HEIGHT, cell_at, cell_centre
from duobench.objects.mazes import MAZES, Maze
from duobench.sim.contacts import Limb, limb_owner
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.tasks.ball_maze import AT_GOAL, LEFT_START
from duobench.types import SIDES, Side
from tests.adversaries.adversary import ONE, TURNS, Adversary, cheats
from tests.sincere.ball_maze import loosened
from tests.steps import do, to

ONE_ARM = Side.LEFT
"""The arm that does everything where one is enough."""
REST = 20
"""Control steps in which the ball comes to rest."""
MAX_SOLVE = 500
"""Control steps after which the ball is not rolled on: the board may have slipped out of a hand."""
MAX_JERKS = 60
"""How often the board is jerked at most."""
YANK_UP, YANK_DOWN, YANK_ASIDE = 0.19, 0.11, 0.12
"""How far the board is yanked up, then down and to a side, in metres from where it is."""
MAX_YANKS = 8
"""How often the board is yanked at most."""


def maze_of(sim: Simulation) -> Maze:
    """The maze of the episode's board."""
    return MAZES[int(sim.variants["board"])]


def from_start(sim: Simulation) -> float:
    """Distance in metres of the ball from the start's centre, in the board's plane."""
    return math.dist(sim.relative_position("ball", "board")[:2], cell_centre(maze_of(sim).start))


def is_ahead(sim: Simulation) -> bool:
    """The ball is out of the start, and its way to the goal does not lead back through it."""
    maze = maze_of(sim)
    cell = cell_at(*sim.relative_position("ball", "board")[:2])
    way = [cell]
    for direction in maze.plan(cell) or ():
        while maze.is_open(way[-1], direction):
            way.append(direction.next(way[-1]))
    return maze.start not in way


def at_goal(*sides: Side) -> Callable[[Simulation], bool]:
    """The ball is at the goal, and exactly these arms hold the board in the air."""

    def holds(sim: Simulation) -> bool:
        x, y, z = sim.relative_position("ball", "board")
        near = math.dist((x, y), cell_centre(maze_of(sim).goal)) <= AT_GOAL and 0 < z < WALL_HEIGHT
        held = {side for side in SIDES if sim.contacts.grasped(side, "board")}
        return near and held == set(sides) and not sim.contacts.between("board", "table")

    return holds


def aside(arms: Arms, side: Side) -> Script:
    """Let go, and bring a gripper out of the way."""
    yield from release(arms, side)
    yield from to(arms, side, arms.targets[side].moved(z=0.12))
    yield from to(arms, side, arms.targets[side].moved(x=-0.1, y=0.2 * side.sign))


def put_down(arms: Arms, side: Side) -> Script:
    """Lay the board on the table, and let it go."""
    board = arms.sim.pose("board")
    x, y, _ = board.translation
    yield from carry(arms, "board", SE3.at(x, y, BASE, yaw=board.yaw), side, speed=0.2)
    yield from wait(REST)
    yield from aside(arms, side)


def settle_at_goal(arms: Arms, *sides: Side) -> Script:
    """Roll the ball to the goal, and right into its corner."""
    yield from islice(solve(arms, *sides), MAX_SOLVE)
    yield from wait(REST)


def begin_alone(arms: Arms) -> Script:
    """One arm lets the ball roll out of the start."""
    for _ in solve(arms, ONE_ARM):
        yield
        if from_start(arms.sim) > PITCH:
            break


def begin(arms: Arms) -> Script:
    """Both arms lift the board and let the ball roll out of the start."""
    for _ in script(arms):
        yield
        if from_start(arms.sim) > LEFT_START:
            break


def yank(arms: Arms) -> Script:
    """The ball hops over walls: the board is yanked away."""
    board = arms.sim.pose("board")
    x, y, z = board.translation
    yield from carry(arms, "board", SE3.at(x, y, z + 0.05, yaw=board.yaw), speed=0.2)
    level = dict(arms.targets)
    for number in range(MAX_YANKS):
        turn = number * math.radians(135)
        aside = YANK_ASIDE * math.cos(turn), YANK_ASIDE * math.sin(turn)
        hops = False
        for away in ((0.0, 0.0, YANK_UP), (*aside, -YANK_DOWN), (0.0, 0.0, 0.0)):
            arms.targets = {side: pose.moved(*away) for side, pose in level.items()}
            for _ in range(5 if any(away) else REST):
                yield
                # From the start it may begin again.
                hops = hops and from_start(arms.sim) > LEFT_START
                hops = hops or arms.sim.relative_position("ball", "board")[2] > WALL_HEIGHT
        if hops and is_ahead(arms.sim):
            yield from settle_at_goal(arms, *SIDES)
            return


def shake(arms: Arms) -> Script:
    """The board is jerked about on the table until the ball is out of the start, then lifted."""
    yield from grasp(arms, *SIDES)
    pressed = {side: pose.moved(z=-0.004) for side, pose in arms.targets.items()}
    for jerk in range(MAX_JERKS):
        turn = jerk * math.radians(135)
        way = 0.05 * math.cos(turn), 0.05 * math.sin(turn)
        arms.targets = {side: pose.moved(*way) for side, pose in pressed.items()}
        yield from wait(5)
        if is_ahead(arms.sim):
            yield from wait(REST)
        if is_ahead(arms.sim):
            break
    else:
        return
    yield from lift(arms, *SIDES)
    yield from settle_at_goal(arms, *SIDES)


def push_the_ball(arms: Arms) -> Script:
    """A finger pushes the ball out of the start; then all is done as it should be."""
    yield from grip(arms, ONE_ARM)
    maze, board = maze_of(arms.sim), arms.sim.pose("board")
    start, way = np.array(cell_centre(maze.start)), np.array(maze.plan(maze.start)[0].value)
    yaw = nearest_turn(board.yaw, math.pi / 2)
    for reach in (-0.006, 0.05):
        x, y = start + reach * way
        tip = down(*board.apply(np.array([x, y, 2 * BALL_RADIUS])), yaw=yaw)
        if reach < 0.0:
            yield from to(arms, ONE_ARM, tip.moved(z=0.08))
        yield from to(arms, ONE_ARM, tip, speed=0.1)
    yield from to(arms, ONE_ARM, arms.targets[ONE_ARM].moved(z=0.12))
    yield from aside(arms, ONE_ARM)
    if is_ahead(arms.sim):
        yield from islice(script(arms), MAX_SOLVE)
        yield from wait(REST)


def press_half_open_fingers(arms: Arms) -> Script:
    """Half-open fingers are pressed on top of two grips, along their bars."""
    across = SE3.at(yaw=math.pi / 2)
    above = {s: pose.moved(z=0.03) @ across for s, pose in grip_poses(arms, *SIDES).items()}
    yield from come_down(arms, above, opening=0.55, above=0.06)
    yield from move(arms, {s: pose.moved(z=-0.05) for s, pose in above.items()}, speed=0.1)
    yield from wait(REST)


def pressed(sim: Simulation) -> bool:
    """Both pads of both grippers touch the board."""
    pads = {
        limb_owner(side, pad) for side in SIDES for pad in (Limb.LEFT_FINGER, Limb.RIGHT_FINGER)
    }
    return pads <= sim.contacts.partners("board")


TAKE, OTHER = do((grasp, ONE_ARM), (lift, ONE_ARM)), ONE_ARM.other
TAKE_OTHER = do((grasp, OTHER), (lift, OTHER))
cheat = cheats(at_goal(*SIDES))
ADVERSARIES: tuple[Adversary, ...] = (
    cheat(
        "one arm alone lifts the board and solves the maze",
        1,
        *(TAKE, (settle_at_goal, ONE_ARM)),
        **ONE,
        deed=at_goal(ONE_ARM),
    ),
    cheat(
        "one arm begins and puts the board down, the other one solves the maze",
        1,
        *(TAKE, begin_alone, (put_down, ONE_ARM), TAKE_OTHER, (settle_at_goal, OTHER)),
        **TURNS,
        deed=at_goal(OTHER),
    ),
    cheat(
        "both arms begin, one goes on alone, both lift the board again",
        3,
        *(begin, (aside, OTHER), (settle_at_goal, ONE_ARM), (put_down, ONE_ARM)),
        *((grasp, *SIDES), (lift, *SIDES)),
        lacks="ball rolls while board is not held up by both arms",
    ),
    cheat(
        "one arm loosens its grip for a whole run of the ball",
        3,
        loosened(60, 1),
        lacks="ball rolls while board is not held up by both arms",
    ),
    cheat("the board is yanked away and the ball hops over the walls", 3, begin, yank),
    cheat("the board is jerked about on the table", 2, shake),
    cheat("a finger pushes the ball out of the start", 2, push_the_ball),
    cheat("half-open fingers are pressed on two grips", 1, press_half_open_fingers, deed=pressed),
)
