"""Small scenes for the tests of simulation and stages."""

from duobench.objects.blocks import RED, WHITE, block, cube
from duobench.objects.bowl import bowl
from duobench.objects.chest import chest
from duobench.objects.prop import Prop
from duobench.sim.simulation import Simulation
from duobench.tasks import catalog

EDGE = 0.032
LID = "chest/lid"


def at_reset(name: str, seed: int) -> Simulation:
    """A task's simulation as a reset leaves it."""
    task = catalog.get(name)
    simulation = Simulation(task.props, task.overview)
    simulation.apply(next(iter(task.layouts(seed))))
    simulation.settle()
    return simulation


def scene() -> Simulation:
    """A cube, a slab and a bowl that are free, and a chest that is fixed; not placed yet."""
    return Simulation(
        [
            Prop(name="cube", solid=cube(RED)),
            Prop(name="slab", solid=block(0.10, 0.06, 0.02, WHITE)),
            Prop(name="bowl", solid=bowl(WHITE)),
            chest("chest", body=WHITE, lid=RED),
        ]
    )
