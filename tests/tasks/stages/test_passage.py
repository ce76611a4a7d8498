"""Ways through and around a ring, as places that an object is put to one after another."""

import pytest

from duobench.core.spatial import SE3
from duobench.tasks.stages.logic import Predicate
from duobench.tasks.stages.passage import EXIT_DEPTH, Hole, passage
from duobench.world.objects.blocks import WHITE, cube
from duobench.world.objects.gate import RING_HEIGHT, gate
from duobench.world.objects.prop import Prop
from duobench.world.sim.simulation import Simulation
from tests.predicate_probe import PredicateProbe

LENGTH = 0.096
GATE = SE3.at(0.4, 0.1, yaw=0.5)
PLACES = {
    "n": (0.0, -0.02, 0.0),  # near, before the hole
    "f": (0.0, -0.3, 0.0),  # near, far from it
    "e": (0.0, 0.02, 0.0),  # in front of the exit
    "r": (0.09, 0.02, 0.0),  # in front of the exit, at its rim
    "b": (0.13, 0.02, 0.0),  # beside the exit
    "a": (0.0, 0.02, 0.13),  # above it
    "i": (0.11, 0.02, 0.0),  # inside the hole, too far from its centre
    "d": (0.0, EXIT_DEPTH + 0.03, 0.0),  # on the far side, some way off
}


HOLE = Hole(body="gate", height=RING_HEIGHT, radius=0.10, rim=0.115)


@pytest.fixture(scope="module")
def sim() -> Simulation:
    sim = Simulation(
        (Prop(name="cube", solid=cube(WHITE)), Prop(name="gate", solid=gate(), fixed=True))
    )
    sim.place("gate", GATE)
    return sim


def put(sim: Simulation, x: float, y: float, z: float) -> None:
    """Place the cube, from the middle of the ring."""
    sim.place("cube", GATE @ SE3.at(x, y, RING_HEIGHT + z))
    sim.forward()


def answers_on(sim: Simulation, way: str, held: str) -> tuple[str, str]:
    """Whether the object crosses the hole, and whether it is through, at each place of a way."""
    hands = {"held": ""}
    grasp = Predicate("held", lambda _: hands["held"] == "1")
    words = passage("cube", HOLE, length=LENGTH, held=grasp)
    probes = [PredicateProbe(word, sim) for word in (words.crossing, words.through)]
    answers = []
    for place, hands["held"] in zip(way, held, strict=True):
        put(sim, *PLACES[place])
        answers.append([str(int(probe.ask())) for probe in probes])
    crossing, through = ("".join(column) for column in zip(*answers, strict=True))
    return crossing, through


@pytest.mark.parametrize(
    ("way", "crossing", "through"),
    [
        ("fned", "0010", "0011"),
        ("fnnrrdd", "0001000", "0001111"),
        ("fni", "000", "000"),
        ("fninedd", "0000100", "0000111"),  # too far from the centre, then not
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
        ("nbened", "000000", "000000"),  # around, backwards through, and out again
        ("nbined", "000000", "000000"),  # the same, near the edge
        ("nbenebfned", "0000000010", "0000000011"),  # the same, then back around, and through
        ("e", "0", "0"),
    ],
)
def test_the_way_tells(sim: Simulation, way: str, crossing: str, through: str) -> None:
    assert answers_on(sim, way, "1" * len(way)) == (crossing, through)


@pytest.mark.parametrize(
    ("held", "crossing"),
    [
        ("1111", "0010"),
        ("0010", "0010"),
        ("0100", "0010"),  # a grasp that flickers for one step
        ("1000", "0000"),  # thrown
        ("1001", "0000"),  # and caught
        ("0000", "0000"),
    ],
)
def test_what_comes_through_is_held(sim: Simulation, held: str, crossing: str) -> None:
    answers = answers_on(sim, "fned", held)
    assert answers == (crossing, "0011" if "1" in crossing else "0000")


@pytest.mark.parametrize(
    ("place", "within"),
    [
        ((0.0, -LENGTH / 2 + 0.001, 0.0), True),
        ((0.0, LENGTH / 2 - 0.001, 0.0), True),
        ((0.11, 0.0, 0.0), True),
        ((0.0, -LENGTH / 2 - 0.001, 0.0), False),
        ((0.0, LENGTH / 2 + 0.001, 0.0), False),
        ((0.12, 0.0, 0.0), False),
    ],
)
def test_what_reaches_through_is_within(
    sim: Simulation, place: tuple[float, float, float], within: bool
) -> None:
    words = passage("cube", HOLE, length=LENGTH, held=Predicate("held", lambda _: True))
    put(sim, *place)
    assert PredicateProbe(words.within, sim).ask() == within
