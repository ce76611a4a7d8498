"""Which walls of a compiled maze board stand: the rest can be neither seen nor felt."""

from __future__ import annotations

import mujoco

from duobench.solids.maze_board import picture_numbers, wall_numbers
from duobench.solids.mazes import Maze


def set_walls(model: mujoco.MjModel, board: str, maze: Maze) -> None:
    """Let exactly the walls of a maze stand.

    Args:
        model: A model with a board that was built from `solids.maze_board.board`.
        board: Name of the board's body.
        maze: The maze; the walls are seen if it is one of the ten.
    """
    floor = model.geom(f"{board}:0")
    for segment, number in wall_numbers().items():
        wall, stands = model.geom(f"{board}:{number}"), segment in maze.walls
        wall.contype = floor.contype if stands else 0
        wall.conaffinity = floor.conaffinity if stands else 0
    for known, number in picture_numbers().items():
        model.geom(f"{board}:picture{number}").rgba[3] = 1.0 if known == maze else 0.0


def standing_walls(model: mujoco.MjModel, board: str) -> Maze:
    """The maze whose walls stand on a board."""
    return Maze(
        frozenset(
            segment
            for segment, number in wall_numbers().items()
            if model.geom(f"{board}:{number}").contype[0]
        )
    )
