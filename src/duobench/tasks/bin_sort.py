"""Bin-Sort.

Task:
    Two cubes, a black and a white one, go into the bowl of their colour. Either arm may take
    either cube; nothing couples the arms.

Randomization:
    Each cube anywhere in its half of the table at any yaw, each bowl within 5 cm of its place.

Success:
    Both cubes have lain still for half a second in the bowls of their colours, which stand on the
    table, and were let go there, at most 6 cm above the rim.
"""

from duobench.core.randomness import ANY_YAW, around
from duobench.tasks.paraphrases import kept_paraphrases, paraphrases
from duobench.tasks.stages.logic import all_of, any_of
from duobench.tasks.stages.placing import placed
from duobench.tasks.stages.predicates import lifted_by_any, released
from duobench.tasks.stages.progress import Stage
from duobench.tasks.stages.vessels import Vessel
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import (
    BLACK,
    CHARCOAL,
    CUBE_EDGE,
    PALE,
    WHITE,
    cube,
)
from duobench.world.objects.bowl import (
    FLOOR,
    RADIUS,
    RIM_HEIGHT,
    WALL,
    bowl,
)
from duobench.world.objects.prop import Prop
from duobench.world.sim.layout import Layout

COLOURS = ("white", "black")
BOWL_MARGIN = 0.10
"""Least distance between a cube's centre and a bowl's rim at the start, in metres."""


def _cube(colour: str) -> str:
    return f"{colour}_cube"


def _bowl(colour: str) -> str:
    return f"{colour}_bowl"


def _apart(layout: Layout) -> bool:
    """No cube starts in or under a bowl's rim."""
    return all(
        layout.poses[_cube(one)].distance(layout.poses[_bowl(other)])[0]
        > RADIUS + BOWL_MARGIN
        for one in COLOURS
        for other in COLOURS
    )


_BOWLS = {
    name: Vessel(
        body=_bowl(name),
        radius=RADIUS - WALL,
        rim=RIM_HEIGHT,
        floor=FLOOR,
    )
    for name in COLOURS
}
_IN_BOWL = {name: vessel.received(_cube(name)) for name, vessel in _BOWLS.items()}
_WHITE_IN, _BLACK_IN = (
    (_IN_BOWL[name] & released(_cube(name))).called(
        f"{_cube(name)} lies in {_bowl(name)}"
    )
    for name in COLOURS
)
_WHITE_LIFTED, _BLACK_LIFTED = (lifted_by_any(_cube(colour)) for colour in COLOURS)
_BOTH_IN = all_of(*_IN_BOWL.values())

TASK = Task(
    id="bin_sort",
    title="Bin-Sort",
    category=Category.PARALLEL_EXECUTION,
    instruction="Lower the white cube into the white bowl and the black cube into the black bowl.",
    paraphrases=paraphrases("bin_sort"),
    kept_paraphrases=kept_paraphrases("bin_sort"),
    horizon=216,
    props=(
        Prop(name="white_cube", solid=lambda: cube(WHITE)),
        Prop(name="black_cube", solid=lambda: cube(BLACK)),
        Prop(name="white_bowl", solid=lambda: bowl(WHITE)),
        Prop(name="black_bowl", solid=lambda: bowl(CHARCOAL, rim=PALE)),
    ),
    placements={
        "white_cube": Placement(
            x=around(0.5, 0.175), y=around(0.2, 0.125), z=CUBE_EDGE / 2, yaw=ANY_YAW
        ),
        "black_cube": Placement(
            x=around(0.5, 0.175), y=around(-0.2, 0.125), z=CUBE_EDGE / 2, yaw=ANY_YAW
        ),
        "white_bowl": Placement(x=around(0.6, 0.05), y=around(0.4, 0.05)),
        "black_bowl": Placement(x=around(0.6, 0.05), y=around(-0.4, 0.05)),
    },
    accept=_apart,
    stages=(
        Stage(
            name="a cube is lifted",
            instruction="Pick up one of the cubes.",
            holds=_WHITE_LIFTED | _BLACK_LIFTED,
            stays=any_of(_WHITE_LIFTED, _BLACK_LIFTED, *_IN_BOWL.values()),
        ),
        Stage(
            name="both cubes are lifted, or one is in its bowl",
            instruction="Pick up the other cube as well.",
            holds=any_of(_WHITE_LIFTED & _BLACK_LIFTED, *_IN_BOWL.values()),
            stays=any_of(_WHITE_LIFTED & _BLACK_LIFTED, *_IN_BOWL.values()),
        ),
        Stage(
            name="one cube lies in its bowl",
            instruction="Lower one cube into the bowl of its colour and let go of it.",
            holds=_WHITE_IN | _BLACK_IN,
            stays=_WHITE_IN | _BLACK_IN,
        ),
        Stage(
            name="one cube lies in its bowl, the other is lifted",
            instruction="Pick up the other cube.",
            holds=any_of(_WHITE_IN & _BLACK_LIFTED, _BLACK_IN & _WHITE_LIFTED),
            stays=any_of(
                _WHITE_IN & _BLACK_LIFTED, _BLACK_IN & _WHITE_LIFTED, _BOTH_IN
            ),
        ),
        Stage(
            name="both cubes lie in their bowls",
            instruction="Lower the other cube into the bowl of its colour and let go of it.",
            holds=placed(_WHITE_IN, _BLACK_IN),
        ),
    ),
    expert="duobench.tasks.experts.scripts.bin_sort:script",
    printable=True,
    real=True,
)
