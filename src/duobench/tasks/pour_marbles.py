"""Pour-Marbles.

Task:
    Each arm grasps the cup on its side; twenty marbles are poured from one to the other in air.

Randomization:
    Each cup within 5 cm of its square's centre; which cup holds the marbles.

Success:
    Both cups have stood on their squares for half a second, upright, put down there or at most 3 cm
    beside them by their arms, and let go, with all marbles in the target.
"""

from collections.abc import Callable

from duobench.core.randomness import Choice, around
from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Side
from duobench.tasks.object_state import chosen, heap, pose
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages import predicates as is_
from duobench.tasks.stages.logic import Predicate, all_of, any_of
from duobench.tasks.stages.placing import low_over, placed, put
from duobench.tasks.stages.pouring import Pouring, pouring
from duobench.tasks.stages.progress import Stage
from duobench.tasks.stages.vessels import stands_upright
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects import cup as cups
from duobench.world.objects.prop import Prop
from duobench.world.scene.naming import TABLE
from duobench.world.sim.layout import Layout

MARBLES = tuple(f"marble{number}" for number in range(len(cups.HEAP)))
CUPS = {side: f"{side}_cup" for side in SIDES}
SQUARES = {side: f"{side}_square" for side in SIDES}
SQUARE_CENTRES = {SQUARES[Side.LEFT]: (0.5, 0.3), SQUARES[Side.RIGHT]: (0.5, -0.3)}
HALF_SQUARE, RAISE = 0.05, 0.020
"""Largest distance of a cup from its square's centre in x and y, and least lift, in metres."""
SHOVE = 0.03
"""Distance in metres beside its square where a cup may be put down: it may be shoved that far."""
GREEN, LIGHT = (0.20, 0.62, 0.27, 1.0), (0.92, 0.93, 0.95, 1.0)
BLUE = (0.10, 0.28, 0.78, 1.0)


def _fill(layout: Layout) -> Layout:
    """Put the marbles into the full cup, and name the other one the empty one."""
    full = Side(layout.variants["full"])
    cup = layout.poses[CUPS[full]]
    heap = {
        name: cup @ SE3.at(*at) for name, at in zip(MARBLES, cups.HEAP, strict=True)
    }
    variants = {"full": full.value, "empty": full.other.value}
    return Layout(poses={**layout.poses, **heap}, variants=variants)


def _in_square(side: Side, more: float = 0.0) -> Predicate:
    """A cup is inside its square, `more` metres beside it at most."""
    half = HALF_SQUARE + more
    region = is_.BoxRegion(
        body=SQUARES[side], low=(-half, -half, -half), high=(half, half, half)
    )
    return is_.inside(CUPS[side], region)


def _back(side: Side) -> Predicate:
    """A cup stands on the table, upright, inside its square, released and still."""
    cup = CUPS[side]
    return is_.released(cup) & _in_square(side) & (stands_upright(cup) & is_.still(cup))


def _put_back(side: Side) -> Predicate:
    """Its arm has put a cup down, at most a shove beside its square."""
    there = low_over(CUPS[side], TABLE, 0.0) & _in_square(side, SHOVE)
    return put(CUPS[side], there, side)


def _into_target(which: Callable[[Pouring], Predicate]) -> Predicate:
    """The one about the cup that was empty."""
    return any_of(*(is_.variant("empty", s) & which(p) for s, p in _POURING.items()))


_BACK = tuple(map(_back, SIDES))
_PUT_BACK = all_of(*map(_put_back, SIDES))
_GRASPED = tuple(is_.grasped(side, CUPS[side]) for side in SIDES)
_HELD_UP = all_of(*_GRASPED, *(is_.raised(CUPS[side], RAISE) for side in SIDES))
_POURING = {
    side: pouring(
        MARBLES,
        CUPS[side],
        cups.ROOM,
        held=_HELD_UP,
    )
    for side in SIDES
}
_KEPT = _into_target(lambda p: p.kept)

TASK = Task(
    id="pour_marbles",
    title="Pour-Marbles",
    category=Category.ASYMMETRIC_SUPPORT,
    instruction="Lift each cup with the arm on its side, pour all marbles from the {full} cup into "
    "the {empty} cup while both are in the air, and put both cups upright on their green squares.",
    paraphrases=paraphrases("pour_marbles"),
    kept_paraphrases=kept_paraphrases("pour_marbles"),
    horizon=442,
    props=(
        *(Prop(name=name, solid=lambda: cups.cup(LIGHT)) for name in CUPS.values()),
        *(
            Prop(
                name=name,
                solid=lambda: cups.square_mark(2 * HALF_SQUARE, GREEN),
                fixed=True,
            )
            for name in SQUARES.values()
        ),
        *(Prop(name=name, solid=lambda: cups.marble(BLUE)) for name in MARBLES),
    ),
    placements={
        name: Placement(x=around(x, spread), y=around(y, spread))
        for names, spread in ((CUPS, 0.05), (SQUARES, 0.0))
        for name, (x, y) in zip(names.values(), SQUARE_CENTRES.values(), strict=True)
    },
    variants={"full": Choice(tuple(side.value for side in SIDES))},
    arrange=_fill,
    stages=(
        Stage(
            name="a cup is grasped by the arm on its side",
            instruction="Grasp one of the cups with the arm on its side.",
            holds=any_of(*_GRASPED),
            stays=any_of(*_GRASPED, _KEPT),
        ),
        Stage(
            name="both cups are grasped, each by its arm",
            instruction="Grasp the other cup as well.",
            holds=all_of(*_GRASPED),
            stays=all_of(*_GRASPED) | _KEPT,
        ),
        Stage(
            name="both cups are lifted",
            instruction="Lift both cups.",
            holds=_HELD_UP,
            stays=_HELD_UP | _KEPT,
        ),
        Stage(
            name="one marble is poured",
            instruction="Pour marbles from the {full} cup into the {empty} cup, both in the air.",
            holds=_into_target(lambda p: p.some),
            stays=_KEPT | _into_target(lambda p: p.some),
        ),
        Stage(
            name="all marbles are poured",
            instruction="Pour the other marbles into the {empty} cup as well.",
            holds=_into_target(lambda p: p.all),
            stays=_KEPT,
        ),
        Stage(
            name="both cups are back",
            instruction="Put both cups upright on their green squares and let go.",
            holds=placed(*_BACK, _KEPT) & _PUT_BACK,
        ),
    ),
    object_numbers=(
        *map(pose, CUPS.values()),
        heap("marbles", MARBLES, CUPS.values(), cups.ROOM),
        chosen("full", CUPS),
    ),
    expert="duobench.tasks.experts.scripts.pour_marbles:script",
)
