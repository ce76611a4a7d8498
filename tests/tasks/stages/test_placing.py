"""Putting down, on a block above a plate that a hand could tilt."""

from __future__ import annotations

import math

import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ
from duobench.tasks.stages.logic import Predicate
from duobench.tasks.stages.placing import PUT_HEIGHT, REST_SECONDS, low_over, placed, put
from duobench.tasks.stages.predicates import raised
from duobench.world.objects.blocks import block
from duobench.world.objects.prop import Prop
from duobench.world.sim.layout import Layout
from duobench.world.sim.simulation import Simulation
from tests.predicate_probe import PredicateProbe

EDGE, PLATE = 0.04, (0.20, 0.20, 0.02)
TOP = PLATE[2] / 2
REST = round(REST_SECONDS * CONTROL_HZ)
GREY = (0.5, 0.5, 0.5, 1.0)
HERE = SE3.at(0.5, 0.0, 0.2)
LOW = low_over("block", "plate", TOP)


@pytest.fixture(scope="module")
def sim() -> Simulation:
    props = [
        Prop(name="block", solid=block(EDGE, EDGE, EDGE, GREY)),
        Prop(name="plate", solid=block(*PLATE, GREY), fixed=True),
    ]
    return Simulation(props)


def place(sim: Simulation, gap: float, plate: SE3 = HERE, x: float = 0.0) -> None:
    """Bring the block's lowest point above the plate, straight above a place on its top."""
    foot = plate.apply([x, 0.0, TOP])
    sim.place("plate", plate)
    sim.place("block", SE3.at(foot[0], foot[1], foot[2] + gap + EDGE / 2))
    sim.forward()


def episode(sim: Simulation, question: Predicate) -> PredicateProbe:
    sim.reset_data()
    sim.apply(Layout(poses={"block": SE3.at(0.3, 0.3, EDGE / 2), "plate": HERE}))
    return PredicateProbe(question, sim)


@pytest.mark.parametrize("height", [PUT_HEIGHT, 0.002, 0.03])
def test_low_is_at_most_a_height_above_the_top(sim: Simulation, height: float) -> None:
    """That at which things are put, unless it is another one."""
    word = LOW if height == PUT_HEIGHT else low_over("block", "plate", TOP, height)
    asked = episode(sim, word)
    assert asked.ask(), "what lies lower, beside the top, is for another predicate to tell"
    for share in (-0.2, 0.0, 0.95, 1.05, 2.0):
        place(sim, share * height)
        assert asked.ask() == (share <= 1)


@pytest.mark.parametrize("x", [-0.08, 0.0, 0.08])
@pytest.mark.parametrize("degrees", [-10.0, 10.0])
def test_low_follows_a_plate_that_is_tilted(sim: Simulation, degrees: float, x: float) -> None:
    """Its end may be a few centimetres higher or lower than its middle."""
    plate = HERE @ SE3.about((0, 1, 0), math.radians(degrees))
    asked = episode(sim, LOW)
    for gap, low in ((0.003, True), (0.020, False)):
        place(sim, gap, plate, x)
        assert asked.ask() == low


def test_nothing_is_put_that_no_hand_held(sim: Simulation) -> None:
    asked = episode(sim, put("block", LOW))
    for gap in (0.02, 0.005, 0.0, -0.0001, -0.0001):
        place(sim, gap)
        assert not asked.ask()


def test_placed_means_half_a_second_without_a_break(sim: Simulation) -> None:
    high = raised("block", 0.05)
    asked = episode(sim, placed(high, LOW))
    for _ in range(3):
        place(sim, 0.0)
        assert not any(asked.ask() for _ in range(REST - 1))
        place(sim, 2 * PUT_HEIGHT)
        assert not asked.ask()
    place(sim, 0.0)
    assert [asked.ask() for _ in range(REST + 2)] == [False] * (REST - 1) + [True] * 3
