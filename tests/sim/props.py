"""Small scenes for the tests of simulation and stages."""

from duobench.objects.blocks import RED, WHITE, block, cube
from duobench.objects.bowl import bowl
from duobench.objects.chest import chest
from duobench.objects.prop import Prop
from duobench.sim.simulation import Simulation

EDGE = 0.032
LID = "chest/lid"


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
