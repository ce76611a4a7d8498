"""A ball on a board that is tilted in the air: what counts as its way from a start to a goal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from duobench.stages.logic import Predicate, all_of, any_of, held_for, since
from duobench.stages.placing import REST_SECONDS
from duobench.stages.predicates import BoxRegion, Region, arm_touches, inside, variant
from duobench.types import CONTROL_HZ, SIDES

MIN_SPEED = 0.02
"""Speed on the board in m/s from which a ball rolls; slower, it does not get through a maze."""
SLIP_SECONDS = 0.1
"""How long a grasp may slip, or the board touch the table, while the ball rolls or rests in the
goal, in seconds. A ball that is bumped on the table still rolls when that time is over."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Rolling:
    """Predicates about a ball on its way; made by `rolling`."""

    spoilt: Predicate
    """Something else than tilts of the lifted board moves it: its way begins at the start again."""
    left: Predicate
    """It has rolled away from the start, and the board is lifted."""
    arrived: Predicate
    """It has rolled from the start to the goal and stayed there, and the board is lifted."""


def inside_chosen(prop: str, choice: str, regions: Mapping[str, Region]) -> Predicate:
    """Its centre lies in the region that belongs to what the layout chose.

    Args:
        prop: The prop.
        choice: Name of the layout's variant.
        regions: A region for each of its values; several may have the same one.
    """
    values: dict[Region, list[Predicate]] = {}
    for value, region in regions.items():
        values.setdefault(region, []).append(variant(choice, value))
    each = (any_of(*chosen) & inside(prop, region) for region, chosen in values.items())
    return any_of(*each).called(f"{prop} is at its place for this {choice}")


def rolling(
    ball: str, room: BoxRegion, *, at_start: Predicate, at_goal: Predicate, lifted: Predicate
) -> Rolling:
    """The predicates for a ball and a board.

    The way is spoilt where the ball hops or leaves the board, where any part of the robot touches
    it, and where it rolls although the board is not lifted as it must be.

    Args:
        ball: The ball.
        room: Where the ball's centre is on the board while it is no higher than the walls.
        at_start: The ball is where the way begins.
        at_goal: It is where the way ends.
        lifted: How the board must be held.
    """
    board = room.body
    rolls = Predicate(
        f"{ball} rolls on {board}",
        lambda state: state.simulation.relative_speed(ball, board) >= MIN_SPEED,
        otherwise=lambda _state: f"{ball} does not roll on {board}",
    )
    dropped = held_for(~lifted, SLIP_SECONDS + 1 / CONTROL_HZ)
    dropped = dropped.called(f"{board} is not held up by both arms")
    off_track = (dropped & rolls).called(f"{ball} rolls while {board} is not held up by both arms")
    spoilt = any_of(~inside(ball, room), *(arm_touches(side, ball) for side in SIDES), off_track)
    start = (lifted & at_start).called(f"{ball} is at the start on the lifted {board}")
    begun = since(start, reset=spoilt)
    left = all_of(lifted, ~spoilt, ~at_start, begun).called(f"{ball} rolls away from the start")
    come = all_of(~spoilt, ~dropped, at_goal, since(left, reset=spoilt))
    come = come.called(f"{ball} is at the goal")
    return Rolling(spoilt=spoilt, left=left, arrived=lifted & held_for(come, REST_SECONDS))
