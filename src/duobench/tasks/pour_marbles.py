"""Pour-Marbles.

Task:
    Each arm takes the cup of its side; twenty marbles are poured from one cup into the other.

Randomization:
    Each cup within 5 cm of its square's centre; which cup holds the marbles.

Success:
    Both cups stand upright on their squares, released and still, with all marbles in the target.
"""

from __future__ import annotations

import math

from duobench.randomness import Choice, around
from duobench.sim.layout import Layout
from duobench.solids import cup as cups
from duobench.solids.prop import Prop
from duobench.spatial import SE3
from duobench.stages import predicates as is_
from duobench.stages.predicates import Predicate, all_of, any_of, since
from duobench.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.types import SIDES, Side

MARBLES = tuple(f"marble{number}" for number in range(len(cups.HEAP)))
CUPS = {side: f"{side}_cup" for side in SIDES}
SQUARES = {side: f"{side}_square" for side in SIDES}
SQUARE_CENTRES = {SQUARES[Side.LEFT]: (0.5, 0.3), SQUARES[Side.RIGHT]: (0.5, -0.3)}
HALF_SQUARE, RAISE, UPRIGHT = 0.05, 0.020, math.radians(20.0)
"""How far, in metres, a cup's centre may be from its square's along x and y, and how far a cup is
raised at least; how far it is tilted at most when it stands, in radians."""
GREEN, LIGHT = (0.20, 0.62, 0.27, 1.0), (0.92, 0.93, 0.95, 1.0)
BLUE = (0.10, 0.28, 0.78, 1.0)


def _fill(layout: Layout) -> Layout:
    """Put the marbles into the full cup, and name the other one the empty one."""
    full = Side(layout.variants["full"])
    cup = layout.poses[CUPS[full]]
    heap = {name: cup @ SE3.at(*at) for name, at in zip(MARBLES, cups.HEAP, strict=True)}
    variants = {"full": full.value, "empty": full.other.value}
    return Layout(poses={**layout.poses, **heap}, variants=variants)


def _in_cup(side: Side) -> tuple[Predicate, ...]:
    """Each marble is inside the walls of that cup, up to its rim."""
    low, high = cups.WALL, cups.HEIGHT
    hollow = is_.CylinderRegion(body=CUPS[side], radius=cups.INNER_RADIUS, low=low, high=high)
    return tuple(is_.inside(marble, hollow) for marble in MARBLES)


def _poured(count: int) -> Predicate:
    """At least `count` marbles are in the cup that was empty, after both cups were raised."""
    into = (is_.variant("empty", s.value) & is_.at_least(count, *_IN_CUP[s]) for s in SIDES)
    return since(_RAISED) & any_of(*into)


def _back(side: Side) -> Predicate:
    """A cup stands upright on its square, released and still."""
    cup, half = CUPS[side], HALF_SQUARE
    square = is_.BoxRegion(body=SQUARES[side], low=(-half, -half, -half), high=(half, half, half))
    return all_of(
        is_.upright(cup, UPRIGHT), is_.inside(cup, square), is_.released(cup), is_.still(cup)
    )


_SQUARE = cups.square_mark(2 * HALF_SQUARE, GREEN)
_IN_CUP = {side: _in_cup(side) for side in SIDES}
_PINCHED = tuple(is_.grasped(side, CUPS[side]) for side in SIDES)
_RAISED = all_of(*_PINCHED, *(is_.raised(CUPS[side], RAISE) for side in SIDES))

TASK = Task(
    id="pour_marbles",
    title="Pour-Marbles",
    category=Category.ASYMMETRIC_SUPPORT,
    instruction="Pick up both cups, pour all marbles from the {full} cup into the {empty} cup, and "
    "put both cups back on their green squares.",
    horizon=442,
    props=(
        *(Prop(name=name, solid=cups.cup(LIGHT)) for name in CUPS.values()),
        *(Prop(name=name, solid=_SQUARE, fixed=True) for name in SQUARES.values()),
        *(Prop(name=name, solid=cups.marble(BLUE)) for name in MARBLES),
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
            name="a cup is grasped",
            instruction="Take a cup with the arm of its side.",
            holds=any_of(*_PINCHED),
        ),
        Stage(
            name="both cups are grasped",
            instruction="Take the other cup too.",
            holds=all_of(*_PINCHED),
        ),
        Stage(name="both cups are raised", instruction="Lift both cups.", holds=_RAISED),
        Stage(
            name="a marble is in the target cup",
            instruction="Pour the marbles from the {full} cup into the {empty} cup.",
            holds=_poured(1),
        ),
        Stage(
            name="all marbles are in the target cup",
            instruction="Pour the remaining marbles into the {empty} cup.",
            holds=_poured(len(MARBLES)),
        ),
        Stage(
            name="both cups are back",
            instruction="Put both cups upright on their squares and let go.",
            holds=all_of(_poured(len(MARBLES)), *(_back(side) for side in SIDES)),
        ),
    ),
)
