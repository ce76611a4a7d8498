"""Sincere ways to roll a ball through a maze on a board that both arms lift and tilt."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from duobench.experts.motion import Arms, Script, wait
from duobench.experts.scripts.ball_maze import Handling, TiltedBoard, script, solve, take_up
from duobench.objects.maze_board import BASE, WALL_HEIGHT, cell_centre
from duobench.objects.mazes import MAZES
from duobench.sim.simulation import Simulation
from duobench.types import SIDES, Side
from tests.sincere.sincere import Way, ways_to

NEAR_GOAL = 0.015
"""Largest distance in metres of the ball from the goal's centre [task definitions]."""
IN_THE_AIR = 0.010
"""Height in metres by which a board in the air is raised at least."""
REACH = 0.155
"""Distance in metres from the board's middle to the farthest point of its grips."""
CLEARANCE = 0.008
"""Height in metres that a tilted board keeps above the table: it sags in the grippers."""
BACK_STEPS = 25
"""Control steps for which the ball is let roll back."""
LOOSE, LOOSENED = Side.LEFT, 0.25
"""The hand that loosens its grip, and how far its fingers open: they stay around it."""
SLOWLY, TREMBLING, COMES_AGAIN = 0.15, 0.3, 0.3
"""Shares of the ways taken at random at half the speed, trembling, and in which it rolls back."""


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

    Args:
        runs: How many runs it takes first; more than there are bring it to the goal, out of which
            it rolls before half a second is over.
        handling: How the board is taken and moved.
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


def loosened(steps: int, run: int) -> Callable[[Arms], Script]:
    """During a run, one hand opens for some control steps, and takes its grip again.

    Args:
        steps: For how many.
        run: In which run, from 0.
    """

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


way = ways_to(script, done, Handling())


def safe_tilt(tilt: float, lift: float) -> float:
    """As much of a tilt in radians as a board lifted by so many metres can have above the table."""
    return min(tilt, math.asin((lift - CLEARANCE) / REACH))


def sample(rng: np.random.Generator) -> Way:
    """A way with everything at random."""
    lift = rng.uniform(0.03, 0.09)
    tilt = safe_tilt(math.radians(rng.uniform(6.0, 20.0)), lift)
    handling = Handling(
        other_grips=bool(rng.random() < 0.5),
        grasp_height=rng.uniform(0.026, 0.040),
        lift=lift,
        tilt=tilt,
    )
    runs = int(rng.integers(1, 10)) if rng.random() < COMES_AGAIN else 0
    name = (
        f"{'other' if handling.other_grips else 'near'} grips at "
        f"{1000 * handling.grasp_height:.0f} mm, lift {1000 * lift:.0f} mm, "
        f"tilt {math.degrees(tilt):.0f} deg, back after {runs}"
    )
    back = {"script": comes_again(runs, handling)} if runs else {}
    one = way(name, handling, **back)
    if rng.random() < SLOWLY:
        return replace(one, name=f"{name}, slowly", slowness=2)
    if rng.random() < TREMBLING:
        return replace(one, name=f"{name}, trembling", tremble=0.01)
    return one


WAYS: tuple[Way, ...] = (
    way("the other pair of grips", Handling(other_grips=True)),
    way("tilted by 6 degrees", Handling(tilt=math.radians(6))),
    way("tilted by 20 degrees", Handling(tilt=math.radians(20))),
    way("grasped at 26 mm", Handling(grasp_height=0.026)),
    way("grasped at 40 mm", Handling(grasp_height=0.040)),
    way("lifted by 30 mm", Handling(lift=0.030, tilt=safe_tilt(1.0, 0.030))),
    way("lifted by 90 mm", Handling(lift=0.090)),
    way("the ball rolls back and comes again", script=comes_again(2, Handling())),
    way(
        "the ball rolls out of the goal and comes again",
        script=comes_again(len(MAZES), Handling()),
    ),
    way("one hand loosens for a moment", script=loosened(8, 2)),
    way("the board trembles", tremble=0.01),
    way("at half the speed", slowness=2),
)
