"""Ways to roll a ball through a maze on a board that both arms lift and tilt, and to seem to."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import islice

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.tasks.ball_maze import AT_GOAL, LEFT_START
from duobench.tasks.experts.handling import carry, come_down
from duobench.tasks.experts.motion import (
    Arms,
    Script,
    down,
    grip,
    move,
    nearest_turn,
    release,
    wait,
)
from duobench.tasks.experts.scripts.ball_maze import (
    OPENING,
    Handling,
    TiltedBoard,
    grasp,
    grip_poses,
    lift,
    script,
    solve,
    take_up,
)
from duobench.world.objects.maze_board import (
    BALL_RADIUS,
    BASE,
    PITCH,
    WALL_HEIGHT,
    cell_at,
    cell_centre,
)
from duobench.world.objects.mazes import MAZES, Maze
from duobench.world.sim.simulation import Simulation
from tests.steps import do, pause, to
from tests.ways.way import (
    ONE,
    TURNS,
    Way,
    WayFailedError,
    cheats,
    fingers_on,
    random_tempo,
    ways_to,
)

ONE_ARM = Side.LEFT
"""The arm that does everything where one is enough."""
REST = 20
"""Control steps in which the ball comes to rest."""
MAX_SOLVE, MAX_JERKS, MAX_YANKS = 500, 60, 8
"""Control steps after which the ball is not rolled on, as the board may have slipped out of a hand;
how often the board is jerked or yanked at most."""
YANK_UP, YANK_DOWN, YANK_ASIDE = 0.19, 0.11, 0.12
"""How far the board is yanked up, then down and to a side, in metres from where it is."""
BACK_STEPS = 25
"""Control steps for which the ball is let roll back."""
LOOSE, LOOSENED = Side.LEFT, 0.25
"""The hand that loosens its grip, and how far its fingers open: they stay around it."""


def maze_of(sim: Simulation) -> Maze:
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
    board = arms.sim.pose("board")
    x, y, _ = board.translation
    yield from carry(arms, "board", SE3.at(x, y, BASE, yaw=board.yaw), side, speed=0.2)
    yield from wait(REST)
    yield from aside(arms, side)


def settle_at_goal(arms: Arms, *sides: Side) -> Script:
    yield from islice(solve(arms, *sides), MAX_SOLVE)
    yield from wait(REST)


def begin_alone(arms: Arms) -> Script:
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
    across = SE3.at(yaw=math.pi / 2)
    above = {s: pose.moved(z=0.03) @ across for s, pose in grip_poses(arms, *SIDES).items()}
    yield from come_down(arms, above, opening=0.55, above=0.06)
    yield from move(arms, {s: pose.moved(z=-0.05) for s, pose in above.items()}, speed=0.1)
    yield from wait(REST)


def loosened(steps: int, run: int) -> Callable[[Arms], Script]:
    """During a run, from 0 on, one hand opens for some control steps, and takes its grip again."""

    def play(arms: Arms) -> Script:
        yield from take_up(arms)
        board = TiltedBoard(arms, SIDES, Handling().tilt)
        for _ in range(run):
            yield from board.run(board.next_run())
        for number, _ in enumerate(board.run(board.next_run())):
            arms.openings[LOOSE.index] = LOOSENED if 0 < number <= steps else 0.0
            yield
        arms.openings[LOOSE.index] = 0.0
        yield from wait(5)
        yield from solve(arms, *SIDES, way=Handling())

    return play


def led(arms: Arms, runs: int) -> Script:
    """Both arms lift the board, let the ball roll some runs, and hold it where it lies."""
    yield from take_up(arms)
    board = TiltedBoard(arms, SIDES, Handling().tilt)
    for _ in range(runs):
        yield from board.run(board.next_run())
        yield from board.lean(board.wanted, REST)


def set_down(arms: Arms, runs: int) -> Script:
    """Both arms put the board down after some runs, and leave it."""
    yield from led(arms, runs)
    yield from TiltedBoard(arms, SIDES, 0.0).lean(np.zeros(2), REST)
    board = arms.sim.pose("board")
    x, y, _ = board.translation
    yield from carry(arms, "board", SE3.at(x, y, BASE, yaw=board.yaw), speed=0.1)
    yield from wait(5)
    yield from release(arms, *SIDES, opening=OPENING)
    yield from move(arms, {side: pose.moved(z=0.10) for side, pose in arms.targets.items()})


def jerk_on(arms: Arms, reach: float) -> Script:
    """The board is jerked about on the table until the ball is in another cell."""
    start = cell_at(*arms.sim.relative_position("ball", "board")[:2])
    yield from grasp(arms, *SIDES)
    pressed = {side: pose.moved(z=-0.004) for side, pose in arms.targets.items()}
    for jerk in range(MAX_JERKS):
        turn = jerk * math.radians(135)
        way = reach * math.cos(turn), reach * math.sin(turn)
        arms.targets = {side: pose.moved(*way) for side, pose in pressed.items()}
        yield from wait(5)
        if cell_at(*arms.sim.relative_position("ball", "board")[:2]) != start:
            break
    yield from wait(REST)
    if cell_at(*arms.sim.relative_position("ball", "board")[:2]) == start:
        raise WayFailedError
    yield from release(arms, *SIDES, opening=OPENING)


def raise_an_edge(arms: Arms) -> Script:
    """One arm raises its side of the board until the ball has rolled to another cell."""
    start = cell_at(*arms.sim.relative_position("ball", "board")[:2])
    for side in SIDES:
        yield from grasp(arms, side)
        low = arms.targets[side]
        for _ in to(arms, side, low.moved(z=0.05), speed=0.1):
            yield
        yield from wait(REST)
        yield from to(arms, side, low, speed=0.1)
        yield from aside(arms, side)
        if cell_at(*arms.sim.relative_position("ball", "board")[:2]) != start:
            return


def push_on(arms: Arms) -> Script:
    """A finger pushes the ball on, where it lies."""
    yield from grip(arms, ONE_ARM)
    maze, board = maze_of(arms.sim), arms.sim.pose("board")
    x, y, _ = arms.sim.relative_position("ball", "board")
    way = np.array(maze.plan(cell_at(x, y))[0].value)
    yaw = nearest_turn(board.yaw, math.pi / 2)
    for reach in (-0.020, 0.02):
        tip = down(*board.apply(np.array([*(np.array([x, y]) + reach * way), 0.02])), yaw=yaw)
        if reach < 0.0:
            yield from to(arms, ONE_ARM, tip.moved(z=0.08))
        yield from to(arms, ONE_ARM, tip, speed=0.1)
    yield from aside(arms, ONE_ARM)


def begin_again(arms: Arms) -> Script:
    yield from islice(script(arms), MAX_SOLVE)
    yield from wait(REST)


TAKE, OTHER = do((grasp, ONE_ARM), (lift, ONE_ARM)), ONE_ARM.other
TAKE_OTHER = do((grasp, OTHER), (lift, OTHER))
cheat = cheats(at_goal(*SIDES))
ADVERSARIES: dict[str, Way] = {
    "one arm alone lifts the board and solves the maze": cheat(
        1, TAKE, (settle_at_goal, ONE_ARM), **ONE, deed=at_goal(ONE_ARM)
    ),
    "one arm begins and puts the board down, the other one solves the maze": cheat(
        1,
        TAKE,
        begin_alone,
        (put_down, ONE_ARM),
        TAKE_OTHER,
        (settle_at_goal, OTHER),
        **TURNS,
        deed=at_goal(OTHER),
    ),
    "both arms begin, one goes on alone, both lift the board again": cheat(
        3,
        begin,
        (aside, OTHER),
        (settle_at_goal, ONE_ARM),
        (put_down, ONE_ARM),
        (grasp, *SIDES),
        (lift, *SIDES),
        lacks="ball came to another cell while board was not held up by both arms",
    ),
    "one arm loosens its grip for a whole run of the ball": cheat(
        3, loosened(60, 1), lacks="while board was not held up by both arms"
    ),
    **{
        f"the board is put down half-way, and {how}": cheat(
            3, (set_down, 2), act, begin_again, lacks=lacks
        )
        for how, act, lacks in (
            ("jerked about", (jerk_on, 0.05), "while board was not held up by both arms"),
            ("raised on one side", raise_an_edge, "while board was not held up by both arms"),
            ("a finger pushes the ball on", push_on, "left arm touches ball"),
        )
    },
    "the board is yanked away and the ball hops over the walls": cheat(3, begin, yank),
    "the board is jerked about on the table": cheat(2, shake),
    "a finger pushes the ball out of the start": cheat(2, push_the_ball),
    "half-open fingers are pressed on two grips": cheat(
        1, press_half_open_fingers, deed=fingers_on(dict.fromkeys(SIDES, "board"))
    ),
}

# --- sincere ways ---------------------------------------------------------------------------------

NEAR_GOAL, IN_THE_AIR = 0.015, 0.010
"""Largest distance in metres of the ball from the goal's centre [task definitions], and least
height of a board in the air."""
REACH, CLEARANCE = 0.155, 0.008
"""Distance in metres from the board's middle to the farthest point of its grips, and height that a
tilted board keeps above the table: it sags in the grippers."""


def done(sim: Simulation) -> bool:
    """The ball is at the goal of a board that both grippers hold in the air."""
    maze = MAZES[int(sim.variants["board"])]
    x, y, z = sim.relative_position("ball", "board")
    return (
        math.dist((x, y), cell_centre(maze.goal)) <= NEAR_GOAL
        and 0.0 < z < WALL_HEIGHT
        and sim.position("board")[2] > BASE + IN_THE_AIR
        and not sim.contacts.between("board", "table")
        and all(sim.contacts.gripper(side, "board") for side in SIDES)
    )


def comes_again(runs: int, handling: Handling) -> Callable[[Arms], Script]:
    """The ball rolls back after some runs, is caught, and comes again.

    After more runs than there are it is at the goal, and rolls out before half a second is over.
    """

    def play(arms: Arms) -> Script:
        yield from take_up(arms, handling)
        board = TiltedBoard(arms, SIDES, handling.tilt)
        for _ in range(runs):
            direction = board.next_run()
            if direction is None:
                break
            yield from board.run(direction)
        yield from board.lean(-board.wanted, BACK_STEPS)
        yield from solve(arms, *SIDES, way=handling)

    return play


def safe_tilt(tilt: float, lift: float) -> float:
    """As much of a tilt in radians as a board lifted by so many metres can have above the table."""
    return min(tilt, math.asin((lift - CLEARANCE) / REACH))


def lost_grip(arms: Arms, runs: int, steps: int) -> Script:
    """One hand lets the board go for some control steps, and takes it again, in the air."""
    yield from led(arms, runs)
    yield from release(arms, LOOSE, opening=LOOSENED)
    yield from wait(steps)
    yield from grip(arms, LOOSE)
    yield from wait(5)
    yield from solve(arms, *SIDES)


way = ways_to(script, done, Handling())
SINCERE: dict[str, Way] = {
    "the other pair of grips": way(other_grips=True),
    **{f"tilted by {degrees} degrees": way(tilt=math.radians(degrees)) for degrees in (6, 20)},
    **{f"grasped at {mm} mm": way(grasp_height=mm / 1000) for mm in (26, 40)},
    "lifted by 30 mm": way(lift=0.030, tilt=safe_tilt(1.0, 0.030)),
    "lifted by 90 mm": way(lift=0.090),
    "the ball rolls back and comes again": way(script=comes_again(2, Handling())),
    "the ball rolls out of the goal and comes again": way(
        script=comes_again(len(MAZES), Handling())
    ),
    "one hand loosens for a moment": way(script=loosened(8, 2)),
    **{
        f"the board is put down after {runs} runs and taken up again": way(
            script=do((set_down, runs), (pause, steps), script)
        )
        for runs, steps in ((1, 10), (2, 60), (4, 150))
    },
    **{
        f"one hand loses its grip for {seconds} s": way(
            script=do((lost_grip, 2, round(seconds * CONTROL_HZ)))
        )
        for seconds in (1, 4)
    },
    "the board trembles": way(tremble=0.01),
    "at half the speed": way(slowness=2),
}


def sample(rng: np.random.Generator) -> Way:
    lift = rng.uniform(0.03, 0.09)
    handling = Handling(
        other_grips=bool(rng.random() < 0.5),
        grasp_height=rng.uniform(0.026, 0.040),
        lift=lift,
        tilt=safe_tilt(math.radians(rng.uniform(6.0, 20.0)), lift),
    )
    back = rng.random() < 0.3
    again = comes_again(int(rng.integers(1, 10)), handling) if back else None
    return way(handling, script=again, **random_tempo(rng, trembling=0.25))
