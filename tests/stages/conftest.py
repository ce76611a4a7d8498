"""What tests of the logic of stages share."""

import pytest

from duobench.objects.blocks import RED, cube
from duobench.objects.prop import Prop
from duobench.sim.simulation import Simulation
from tests.stages.bench import Bench


@pytest.fixture(scope="module")
def sim() -> Simulation:
    return Simulation([Prop(name="cube", solid=cube(RED))])


@pytest.fixture
def bench(sim: Simulation) -> Bench:
    return Bench(sim)
