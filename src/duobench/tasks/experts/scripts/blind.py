"""Ball-Maze with closed eyes: the board is lifted and tilted in one fixed sequence.

A baseline: what it wins can be had without a look at the ball or the maze.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np

from duobench.core.types import SIDES
from duobench.tasks.experts.motion import (
    CONTROL_STEP,
    NEAR,
    Arms,
    Script,
    grip,
    move,
)
from duobench.tasks.experts.scripts.ball_maze import (
    OPENING,
    TiltedBoard,
    grip_poses,
    lift,
)
from duobench.world.objects.mazes import Direction

_WORDS = (
    "N10 E12 N10 E10 S18 W18 N12 E12 N10 W18 N15 W10 "
    "N10 S15 E10 S10 W15 S10 W10 S10 E12 S10 E10"
)
_TILTS = {tilt.name[0]: tilt for tilt in Direction}
TILTS: tuple[tuple[Direction, int], ...] = tuple(
    (_TILTS[word[0]], int(word[1:])) for word in _WORDS.split()
)
"""Directions in which the board is tilted, and for how many control steps: a shortest sequence that
brings the ball to rest in the goal of five boards, as many as any that `python -m dev.tools.mazes`
finds."""
TILT, RATE, RAMP = (
    math.radians(14),
    math.radians(120) * CONTROL_STEP,
    math.radians(18) * CONTROL_STEP,
)
"""How far the board is tilted, in radians, how much it turns in one control step at most, and how
much that changes."""
ABOVE = 0.05
"""Height in metres above the grips from which the tools come straight down."""


def ball_maze(arms: Arms) -> Script:
    """Lift the board and tilt it; of all that lies on the table, only the board is looked at."""
    poses = grip_poses(arms, *SIDES)
    arms.openings[:] = OPENING
    above = {side: pose.moved(z=ABOVE) for side, pose in poses.items()}
    yield from move(
        arms,
        above,
        speed=0.8,
        tolerance=NEAR,
    )
    yield from move(arms, poses, speed=0.4)
    yield from grip(arms, *SIDES)
    yield from lift(arms, *SIDES)
    board = TiltedBoard(
        arms,
        SIDES,
        TILT,
        rate=RATE,
        ramp=RAMP,
    )
    for tilt, steps in TILTS:
        yield from board.lean(TILT * np.array(tilt.value), steps)


SCRIPTS: Mapping[str, Callable[[Arms], Script]] = {"ball_maze": ball_maze}
"""The script of each task that can be played like that."""
