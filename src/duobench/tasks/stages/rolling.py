"""Rolling: conditions for a ball's way from start to goal on a board tilted in the air."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from duobench.core.spatial import hypot
from duobench.core.types import CONTROL_HZ, SIDES
from duobench.tasks.stages.logic import (
    Predicate,
    StateView,
    all_of,
    any_of,
    held_for,
    kept,
    leaf,
    since,
)
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.tasks.stages.predicates import (
    BoxRegion,
    Region,
    arm_touches,
    grasped,
    grasped_by_any,
    inside,
    variant,
)

MIN_SPEED = 0.02
"""Speed on the board in m/s from which a ball rolls; slower, it does not get through a maze."""
SLIP_SECONDS = 0.1
"""How long a grasp may slip, or the board touch the table, while the ball rolls or rests in the
goal, in seconds. A ball that is bumped on the table still rolls when that time is over."""
REGRASP_SECONDS = 0.4
"""How long one of the two grasps may be lost while the other hand holds the board in the air, in
seconds, where the ball is in the same cell when both have it again: 0.3 [task definitions], and 0.1
in which fingers that are told to close do so."""
MOST_MOVED = 0.005
"""How far from where the ball came to lie it may be when both hands have a board up again that was
let down, in metres [task definitions]."""
PLACE_UNIT = 0.001
"""Resolution of that position in metres."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
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


def inside_chosen(
    prop: str,
    choice: str,
    regions: Mapping[str, Region],
) -> Predicate:
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

    The way is spoilt where the ball hops or leaves the board, and where any part of the robot
    touches it. A board that slipped, or was let down, for however long, goes on where both hands
    have it up again with the ball in the same cell, where it came to lie.

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
    # In one hand still, the ball may roll for a moment more.
    let_down = any_of(
        held_for(~(in_air & grasped_by_any(board)), SLIP_SECONDS + step),
        held_for(~lifted, REGRASP_SECONDS + step),
    )
    lain = since(
        held_for((dropped & ~rolls).called(f"{ball} lies still"), SLIP_SECONDS),
        reset=lifted,
    )
    side = room.high[0] - room.low[0]
    ways = [partial(_from_corner, ball, room, axis) for axis in (0, 1)]

    def strayed(
        when: Predicate, unit: float, far: Callable[[float, float], bool]
    ) -> Predicate:
        """The ball is far from where it was, in whole units, when something last held."""
        places = [
            kept(
                f"place of {ball}",
                way,
                when=when,
                unit=unit,
                most=side,
            )
            for way in ways
        ]
        bits = tuple(bit for place in places for bit in place.bits)

        def test(state: StateView) -> bool:
            x, y = (
                way(state) - at.value(state)
                for way, at in zip(ways, places, strict=True)
            )
            return far(x, y)

        return Predicate(f"{ball} has strayed", test, bits)

    pitch, middle = side / cells, PLACE_UNIT / 2
    in_other_cell = strayed(
        lifted, pitch, lambda x, y: not 0.0 <= min(x, y) <= max(x, y) < pitch
    )
    moved = strayed(
        dropped & ~lain,
        PLACE_UNIT,
        lambda x, y: hypot(x - middle, y - middle) > MOST_MOVED,
    )
    after = f"while {board} was not held up by both arms"
    again = lifted & since(dropped & since(lifted), reset=lifted)
    lost = all_of(again, since(let_down, reset=lifted), ~lain | moved)
    spoilt = any_of(
        ~inside(ball, room),
        *(arm_touches(side, ball) for side in SIDES),
        (again & in_other_cell).called(f"{ball} came to another cell {after}"),
        lost.called(f"{ball} rolled {after}"),
    )
    start = (lifted & at_start).called(f"{ball} is at the start on the lifted {board}")
    begun = since(start, reset=spoilt)
    left = all_of(lifted, ~spoilt, ~at_start, begun).called(
        f"{ball} rolls away from the start"
    )
    underway = since(left, reset=spoilt)
    come = all_of(~spoilt, ~dropped, at_goal, underway).called(f"{ball} is at the goal")
    return Rolling(
        spoilt=spoilt,
        left=left,
        underway=underway,
        arrived=lifted & held_for(come, REST_SECONDS),
    )


def _from_corner(
    ball: str,
    room: BoxRegion,
    axis: int,
    state: StateView,
) -> float:
    """Distance of the ball from the lowest corner of the room along an axis, in metres."""
    return state.relative_position(ball, room.body)[axis] - room.low[axis]
