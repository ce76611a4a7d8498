"""Block-Balance.

Task:
    A beam goes across a small red cube, and two blocks onto the ends of the beam, together. With
    the beam's middle on the cube's, one block alone tips it; 10 mm off it need not, therefore the
    rule asks for both at once.

Randomization:
    Beam and cube near the middle, 8 cm apart, so that neither hides the other, and one block in
    each half, all within a few centimetres and without yaw.

Success:
    Both blocks stand on the ends of the level beam, the beam on the cube, all let go and still for
    half a second, after each arm had its block in hand until both were on or little above the beam,
    where they came within 1.5 s of each other; one that hops came when it first touched, unless it
    was away for a second.
"""

import math

from duobench.core.randomness import around
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages import predicates as is_
from duobench.tasks.stages.coordination import brought_together
from duobench.tasks.stages.logic import (
    Predicate,
    all_of,
    any_of,
    since,
)
from duobench.tasks.stages.placing import (
    left_alone,
    low_over,
    placed,
    put,
)
from duobench.tasks.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import (
    RED,
    WOOD,
    YELLOW,
    block,
)
from duobench.world.objects.prop import Prop

CUBE_EDGE = 0.040
BEAM = (0.040, 0.200, 0.020)
"""The beam lies along y: width, length, height in metres."""
BLOCK = (0.030, 0.030, 0.090)
"""A block stands upright."""
TIPPING = CUBE_EDGE / 2 * (1 + math.prod(BEAM) / math.prod(BLOCK))
"""Distance in metres (60 mm) from a beam's middle at which one block of its density tips it."""


def _over_beam(low: float, high: float) -> is_.BoxRegion:
    """A stretch of the beam, in metres from its middle, and what is above it."""
    half = BEAM[0] / 2
    return is_.BoxRegion(body="beam", low=(-half, low, 0), high=(half, high, BLOCK[2]))


ENDS = _over_beam(-BEAM[1] / 2, -TIPPING), _over_beam(TIPPING, BEAM[1] / 2)


def _loaded(end: is_.BoxRegion) -> Predicate:
    """One of the blocks is over an end of the beam."""
    away = f"no block is at an end of beam, {1000 * TIPPING:.0f} mm from its middle at least"
    here = any_of(*(is_.inside(name, end) for name in BLOCKS))
    return here.called("a block is over an end of beam", lambda _state: away)


LEVEL_DEGREES, STANDING_DEGREES = 12.0, 20.0
"""Largest tilts of a level beam and of a block that stands on it."""
LYING = 0.005
"""Depth in metres below the cube's top at which a beam on it may seem to be."""
BLOCKS = ("left_block", "right_block")

_ON_CUBE = is_.touching("beam", "cube") & is_.off_table("beam")
_LEVEL = is_.upright("beam", math.radians(LEVEL_DEGREES))
# The table carries no block, and each is on the beam, or so little above that it is put there.
_BEAM = _over_beam(-BEAM[1] / 2, BEAM[1] / 2)
_LOW = {
    name: all_of(
        low_over(name, "beam", BEAM[2] / 2),
        is_.inside(name, _BEAM),
        is_.off_table(name),
    )
    for name in BLOCKS
}
_AT_ENDS = all_of(*map(_loaded, ENDS), *_LOW.values())
_ON_BEAM = all_of(_AT_ENDS, *(is_.touching(name, "beam") for name in BLOCKS))
_HELD = is_.lifted_by_any("beam")
_LAID = put("beam", low_over("beam", "cube", CUBE_EDGE / 2)) & is_.raised(
    "beam", CUBE_EDGE - LYING
)
_BRIDGE = placed(is_.rests_on("beam", "cube"), _LEVEL, is_.released("beam")) & _LAID
_GRASPED = is_.grasped_apart(*BLOCKS)
_BRIDGED = since(_BRIDGE.called("the beam lies across the cube"))
_READY = all_of(_GRASPED, _ON_CUBE, _BRIDGED)
# Blocks that were put on one after the other, and grasped again, were not put on together.
_TOGETHER = brought_together(*BLOCKS, _LOW)
_LOADED = all_of(
    _AT_ENDS, _ON_CUBE, _TOGETHER, since(_READY.called("both are grasped"))
)
_LEFT = any_of(*map(is_.interrupted, _LOW.values()))
_ONCE_LOADED = since(
    _LOADED.called("both arms have both blocks on the beam"), reset=_LEFT
)
_STANDING = all_of(
    *(is_.upright(name, math.radians(STANDING_DEGREES)) for name in BLOCKS)
)
_BALANCED = placed(
    _ON_BEAM, _ON_CUBE, _LEVEL, _STANDING, left_alone("cube", "beam", *BLOCKS)
)

TASK = Task(
    id="block_balance",
    title="Block-Balance",
    category=Category.BIMANUAL_MANIPULATION,
    instruction="Put the beam across the red cube, grasp one block with each arm, stand both "
    "blocks on the ends of the beam at the same time, and let go, so that everything stays "
    "balanced.",
    paraphrases=paraphrases("block_balance"),
    kept_paraphrases=kept_paraphrases("block_balance"),
    horizon=766,
    props=(
        Prop(name="cube", solid=lambda: block(CUBE_EDGE, CUBE_EDGE, CUBE_EDGE, RED)),
        Prop(name="beam", solid=lambda: block(*BEAM, WOOD)),
        *(Prop(name=name, solid=lambda: block(*BLOCK, YELLOW)) for name in BLOCKS),
    ),
    placements={
        "cube": Placement(x=around(0.58, 0.03), y=around(0.0, 0.04), z=CUBE_EDGE / 2),
        "beam": Placement(x=around(0.44, 0.03), y=around(0.0, 0.03), z=BEAM[2] / 2),
        "left_block": Placement(
            x=around(0.5, 0.05), y=around(0.24, 0.04), z=BLOCK[2] / 2
        ),
        "right_block": Placement(
            x=around(0.5, 0.05), y=around(-0.24, 0.04), z=BLOCK[2] / 2
        ),
    },
    stages=(
        Stage(
            name="the beam is lifted",
            instruction="Pick up the beam.",
            holds=_HELD,
            stays=_HELD | _ON_CUBE,
        ),
        Stage(
            name="the beam rests on the red cube",
            instruction="Put the middle of the beam on the red cube.",
            holds=_BRIDGE,
            stays=_ON_CUBE & _BRIDGED,
        ),
        Stage(
            name="both blocks are grasped, the beam on the cube",
            instruction="Grasp one block with each arm.",
            holds=_READY,
            stays=_GRASPED | _ONCE_LOADED,
        ),
        Stage(
            name="both blocks are held at their places on the beam, at most 12 mm above it",
            instruction="Put both blocks upright onto the ends of the beam at the same time.",
            holds=_LOADED,
            stays=_ONCE_LOADED,
        ),
        Stage(
            name="everything is balanced",
            instruction="Let go of both blocks and move away.",
            holds=_BALANCED
            & _ONCE_LOADED.told_of("when both were last in hand", _GRASPED),
        ),
    ),
    expert="duobench.tasks.experts.scripts.block_balance:script",
    printable=True,
)
