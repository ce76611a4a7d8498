"""Ball-Maze with closed eyes: the board is lifted and tilted in one fixed sequence, whatever it is.

A baseline: what it wins can be had without a look at the ball or the maze.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from duobench.experts.motion import Arms, Script
from duobench.experts.scripts.ball_maze import TiltedBoard, take_up
from duobench.objects.mazes import Direction
from duobench.types import SIDES

E, N, W, S = Direction
TILTS: tuple[Direction, ...] = (N, E, S, E, N, W, S, E, S, W, S, E, N, E, S, E)
"""The shortest sequence that brings the ball to rest in the goal of as many boards as any of at
most 19 tilts does; `python -m tools.mazes` proves it."""
TILT_STEPS = 16
"""Control steps that a tilt takes: the ball runs through the whole board, and rests for half a
second where a tilt leaves it."""
TILT = math.radians(15)
"""How far the board is tilted, in radians."""


def ball_maze(arms: Arms) -> Script:
    """Lift the board and tilt it; of all that lies on the table, only the board is looked at."""
    yield from take_up(arms)
    board = TiltedBoard(arms, SIDES, TILT)
    for tilt in TILTS:
        yield from board.lean(TILT * np.array(tilt.value), TILT_STEPS)


SCRIPTS: Mapping[str, Callable[[Arms], Script]] = {"ball_maze": ball_maze}
"""The script of each task that can be played like that."""
