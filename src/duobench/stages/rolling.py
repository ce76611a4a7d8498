"""A ball on a board that is tilted in the air: what counts as its way from a start to a goal."""

from __future__ import annotations

from dataclasses import dataclass

from duobench.stages.predicates import (
    BoxRegion,
    CylinderRegion,
    Predicate,
    all_of,
    any_of,
    arm_touches,
    held_for,
    inside,
    since,
)
from duobench.types import SIDES

MIN_SPEED = 0.02
"""Speed on the board in m/s from which a ball rolls; slower, it does not get through a maze."""
MAX_SLIP = 0.1
"""How long a grasp may slip, or the board touch the table, while the ball rolls, in seconds. A ball
that is bumped on the table still rolls when that time is over."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Rolling:
    """Predicates about a ball on its way; made by `rolling`."""

    spoilt: Predicate
    """Something else than tilts of the lifted board moves it: its way begins at the start again."""
    left: Predicate
    """It has rolled away from the start, and the board is lifted."""
    arrived: Predicate
    """It has rolled from the start to the goal, and the board is lifted."""


def rolling(
    ball: str,
    room: BoxRegion,
    *,
    start: CylinderRegion,
    goal: CylinderRegion,
    lifted: Predicate,
) -> Rolling:
    """The predicates for a ball and a board.

    The way is spoilt where the ball hops or leaves the board, where any part of the robot touches
    it, and where it rolls although the board is not lifted as it must be.

    Args:
        ball: The ball.
        room: Where the ball's centre is on the board while it is no higher than the walls.
        start: Where the way begins.
        goal: Where it ends.
        lifted: How the board must be held.
    """
    board = room.body
    rolls = Predicate(
        f"{ball} rolls on {board}",
        lambda m: m.simulation.relative_speed(ball, board) >= MIN_SPEED,
    )
    spoilt = any_of(
        ~inside(ball, room),
        *(arm_touches(side, ball) for side in SIDES),
        held_for(~lifted, MAX_SLIP) & rolls,
    )
    begun = since(lifted & inside(ball, start), reset=spoilt)
    left = all_of(lifted, ~spoilt, ~inside(ball, start), begun)
    arrived = all_of(lifted, ~spoilt, inside(ball, goal), since(left, reset=spoilt))
    return Rolling(spoilt=spoilt, left=left, arrived=arrived)
