"""What tests of the logic of stages share."""

import pytest

from duobench.world.objects.blocks import RED, cube
from duobench.world.objects.prop import Prop
from duobench.world.sim.simulation import Simulation
from tests.tasks.stages.bench import Bench


@pytest.fixture(scope="module")
def sim() -> Simulation:
    return Simulation([Prop(name="cube", solid=cube(RED))])


@pytest.fixture
def bench(sim: Simulation) -> Bench:
    return Bench(sim)
