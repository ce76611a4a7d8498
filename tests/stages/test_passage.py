"""Ways through and around a ring, as places that an object is put to one after another."""

import pytest

from duobench.sim.simulation import Simulation
from duobench.solids.blocks import WHITE, cube
from duobench.solids.gate import RING_HEIGHT, gate
from duobench.solids.prop import Prop
from duobench.spatial import SE3
from duobench.stages.passage import EXIT_DEPTH, Hole, passage
from tests.recall import Recall

RADIUS = 0.10
GATE = SE3.at(0.4, 0.1, yaw=0.5)
PLACES = {
    "n": (0.0, -0.02, 0.0),  # near, before the hole
    "f": (0.0, -0.3, 0.0),  # near, far from it
    "e": (0.0, 0.02, 0.0),  # in front of the exit
    "r": (0.09, 0.02, 0.0),  # in front of the exit, at its rim
    "b": (0.11, 0.02, 0.0),  # beside the exit
    "a": (0.0, 0.02, 0.11),  # above it
    "d": (0.0, EXIT_DEPTH + 0.03, 0.0),  # on the far side, some way off
}


@pytest.fixture(scope="module")
def sim() -> Simulation:
    return Simulation(
        (Prop(name="cube", solid=cube(WHITE)), Prop(name="gate", solid=gate(), fixed=True))
    )


@pytest.mark.parametrize(
    ("way", "crossing", "through"),
    [
        ("fned", "0010", "0011"),
        ("fnnrrdd", "0001100", "0001111"),
        ("fnb", "000", "000"),
        ("fna", "000", "000"),
        ("fnd", "000", "000"),
        ("fnbed", "00000", "00000"),  # around, then into the exit from the far side
        ("nedf", "0100", "0110"),
        ("nedfb", "01000", "01100"),  # through, back, around
        ("bfned", "00010", "00011"),  # around, back, through
        ("nededed", "0100000", "0111111"),
        ("nenbed", "010000", "010000"),  # through, back, around into the exit
        ("nenened", "0101010", "0101011"),
        ("e", "0", "0"),
    ],
)
def test_the_way_tells(sim: Simulation, way: str, crossing: str, through: str) -> None:
    words = passage("cube", Hole(body="gate", height=RING_HEIGHT, radius=RADIUS))
    crosses, came_through = Recall(words.crossing), Recall(words.through)
    sim.place("gate", GATE)
    answers = []
    for place in way:
        x, y, z = PLACES[place]
        sim.place("cube", GATE @ SE3.at(x, y, RING_HEIGHT + z))
        sim.refresh()
        answers.append((crosses.ask(sim), came_through.ask(sim)))
    expected = [(c == "1", t == "1") for c, t in zip(crossing, through, strict=True)]
    assert answers == expected
