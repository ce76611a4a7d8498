"""A task of 36 steps, which any motion of the left arm solves where the cube lies on the left."""

from duobench.core.randomness import around
from duobench.tasks.stages.logic import Predicate, StateView
from duobench.tasks.stages.progress import Stage
from duobench.tasks.task import Category, Placement, Task
from duobench.world.objects.blocks import CUBE_EDGE, RED, cube
from duobench.world.objects.prop import Prop

HORIZON = 36
HOME_HEIGHT = 0.54


def _moved(moment: StateView) -> bool:
    height = moment.simulation.site_pose("left/tcp").translation[2]
    return abs(float(height) - HOME_HEIGHT) > 0.05


def _on_the_left(moment: StateView) -> bool:
    return float(moment.simulation.pose("cube").translation[1]) > 0.0


MOVED = Predicate("the left tool moved", _moved)
TASK = Task(
    id="swing",
    title="Swing",
    category=Category.PARALLEL_EXECUTION,
    instruction="Put the cube into the bowl.",
    horizon=HORIZON,
    props=(Prop(name="cube", solid=cube(RED)),),
    placements={"cube": Placement(x=around(0.5, 0.1), y=around(0, 0.2), z=CUBE_EDGE / 2)},
    stages=(
        Stage(name="moved", instruction="Move.", holds=MOVED),
        Stage(
            name="the cube is on the left",
            instruction="Wait.",
            holds=MOVED & Predicate("the cube is on the left", _on_the_left),
        ),
    ),
)
