"""Small scenes for the tests of simulation and stages."""

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import DuoCommand, Side
from duobench.tasks import catalog
from duobench.world.objects.blocks import RED, WHITE, block, cube
from duobench.world.objects.bowl import bowl
from duobench.world.objects.chest import chest
from duobench.world.objects.prop import Prop
from duobench.world.robot.frames import ROBOT
from duobench.world.scene.naming import tcp_name
from duobench.world.sim.simulation import Simulation

EDGE = 0.032
LID = "chest/lid"
REST = {
    "cube": SE3.at(0.5, 0.1, EDGE / 2, yaw=0.3),
    "slab": SE3.at(0.5, -0.2, 0.01),
    "bowl": SE3.at(0.7, 0.3),
    "chest": SE3.at(0.7, -0.3, yaw=0.1),
}
"""Where the objects of `scene` stand on the table."""


def hold(
    sim: Simulation, name: str, *, steps: int, opening: float = 0.0, depth: float = 0.0
) -> None:
    """The left gripper closes on an object that is kept between its fingers, so deep in metres."""
    for other, x in (("slab", 0.4), ("bowl", 0.6), ("chest", 0.8)):
        sim.place(other, SE3.at(x, -0.5, 0.011))
    tool = sim.site_pose(tcp_name(Side.LEFT)) @ SE3.at(z=-depth)
    for _ in range(steps):
        sim.place(name, tool)
        sim.forward()
        sim.step(DuoCommand(joints=ROBOT.home_command.joints, openings=np.array([opening, 1.0])))


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
