"""A ball on a board that is tilted in the air: what counts as its way from a start to a goal."""

from collections.abc import Mapping
from dataclasses import dataclass

from duobench.stages.logic import Predicate, StateView, all_of, any_of, held_for, leaf, since
from duobench.stages.placing import REST_SECONDS
from duobench.stages.predicates import (
    BoxRegion,
    Region,
    arm_touches,
    grasped,
    grasped_by_any,
    inside,
    variant,
)
from duobench.types import CONTROL_HZ, SIDES

MIN_SPEED = 0.02
"""Speed on the board in m/s from which a ball rolls; slower, it does not get through a maze."""
SLIP_SECONDS = 0.1
"""How long a grasp may slip, or the board touch the table, while the ball rolls or rests in the
goal, in seconds. A ball that is bumped on the table still rolls when that time is over."""
REGRASP_SECONDS = 0.4
"""How long one of the two grasps may be lost while the other hand holds the board in the air, in
seconds, where the ball is in the same cell when both have it again: 0.3 [task definitions], and 0.1
in which fingers that are told to close do so."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Rolling:
    """Predicates about a ball on its way; made by `rolling`."""

    spoilt: Predicate
    """Something else than tilts of the lifted board moves it: its way begins at the start again."""
    left: Predicate
    """It has rolled away from the start, and the board is lifted."""
    underway: Predicate
    """It has rolled away from the start, and its way is not spoilt."""
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
    ball: str,
    room: BoxRegion,
    *,
    cells: int,
    at_start: Predicate,
    at_goal: Predicate,
    in_air: Predicate,
) -> Rolling:
    """The predicates for a ball and a board.

    The way is spoilt where the ball hops or leaves the board, where any part of the robot touches
    it, and where it rolls although the board is not held up in both hands, but for a moment.

    Args:
        ball: The ball.
        room: Where the ball's centre is on the board while it is no higher than the walls.
        cells: How many rows and columns of cells the room has.
        at_start: The ball is where the way begins.
        at_goal: It is where the way ends.
        in_air: The board is where both hands must hold it.
    """
    board = room.body
    rolls = leaf(
        f"{ball} rolls on {board}",
        lambda state: state.simulation.relative_speed(ball, board) >= MIN_SPEED,
        otherwise=lambda _state: f"{ball} does not roll on {board}",
    )
    lifted = all_of(in_air, *(grasped(side, board) for side in SIDES))
    step = 1 / CONTROL_HZ
    dropped = held_for(~lifted, SLIP_SECONDS + step)
    dropped = dropped.called(f"{board} is not held up by both arms")
    # In one hand still, the ball may roll for a moment more, if it comes to no other cell.
    let_down = any_of(
        held_for(~(in_air & grasped_by_any(board)), SLIP_SECONDS + step),
        held_for(~lifted, REGRASP_SECONDS + step),
    )
    off_track = (let_down & rolls).called(f"{ball} rolls while {board} is not held up by both arms")
    elsewhere = all_of(
        lifted, since(dropped, reset=lifted), _in_another_cell(ball, room, cells, lifted)
    )
    spoilt = any_of(
        ~inside(ball, room),
        *(arm_touches(side, ball) for side in SIDES),
        off_track,
        elsewhere.called(f"{ball} came to another cell while {board} was not held up by both arms"),
    )
    start = (lifted & at_start).called(f"{ball} is at the start on the lifted {board}")
    begun = since(start, reset=spoilt)
    left = all_of(lifted, ~spoilt, ~at_start, begun).called(f"{ball} rolls away from the start")
    underway = since(left, reset=spoilt)
    come = all_of(~spoilt, ~dropped, at_goal, underway).called(f"{ball} is at the goal")
    return Rolling(
        spoilt=spoilt,
        left=left,
        underway=underway,
        arrived=lifted & held_for(come, REST_SECONDS),
    )


def _in_another_cell(ball: str, room: BoxRegion, cells: int, lifted: Predicate) -> Predicate:
    """The ball is in another row or column than at the last step at which the board was lifted."""

    def band(axis: int, number: int) -> Predicate:
        pitch = (room.high[axis] - room.low[axis]) / cells
        edge = room.low[axis] + number * pitch

        def test(state: StateView) -> bool:
            at = state.relative_position(ball, room.body)[axis]
            return (edge <= at) & (at < edge + pitch)

        name = f"{ball} is in {'column' if axis == 0 else 'row'} {number}"
        return leaf(name, test)

    bands = [band(axis, number) for axis in (0, 1) for number in range(cells)]
    left = (~here & since(lifted & here, reset=lifted & ~here) for here in bands)
    return any_of(*left)
