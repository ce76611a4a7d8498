"""Support as sequences of moments, most of which two arms really brought about."""

from __future__ import annotations

import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ
from duobench.tasks import catalog
from duobench.tasks.experts.handling import LET_GO
from duobench.tasks.experts.motion import Arms, Script, release, together, wait
from duobench.tasks.shifts.levels import MASS_FACTORS, SPRING_FACTORS
from duobench.tasks.shifts.shift import LEVELS
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.tasks.stages.predicates import FLICKER_SECONDS
from duobench.tasks.stages.support import UNSUPPORTED_SECONDS
from duobench.world.sim.simulation import Simulation
from tests.task_harness import Moments, TaskHarness, set_hinge, take_away
from tests.ways.hinge_chest import CHEST
from tests.ways.opening import Opening
from tests.ways.spring_door import DOOR

LONG = round(UNSUPPORTED_SECONDS * CONTROL_HZ)
GRAZE = round(FLICKER_SECONDS * CONTROL_HZ)
REST = round(REST_SECONDS * CONTROL_HZ)
OPEN, HALF_OPEN = 0.8, 0.79
CASES = {"hinge_chest": CHEST, "spring_door": DOOR}


def lower_onto_the_arm(sim: Simulation, case: Opening) -> None:
    """Shut the lid as far as the arm that brings the cube lets it."""
    angle = sim.angle(case.lid)
    while not sim.contacts.arm(case.bringer, case.lid):
        angle -= 0.01
        set_hinge(sim, case.lid, angle)


def press_it_shut(sim: Simulation, case: Opening) -> None:
    """Turn the lid to where the holding arm touches it and does not push it open."""
    contacts = sim.contacts
    for angle in np.arange(OPEN, sim.model.joint(case.lid).range[1], 0.005):
        set_hinge(sim, case.lid, angle)
        pushes = contacts.pushes(case.holder, case.lid, lambda: sim.hinge_axis(case.lid))
        grasps = contacts.grasped(case.holder, case.lid)
        if contacts.arm(case.holder, case.lid) and not (pushes or grasps):
            return
    pytest.fail("no such angle")


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> Opening:
    return CASES[request.param]


@pytest.fixture(scope="module")
def moments(case: Opening) -> Moments:
    """States by letter.

    What two arms did: (t) at the start; the lid held open and the cube (h)eld, come (n)ear,
    (i)nside but pinched, (f)ree inside. What is made of that: as h, but (a)way from the lid is the
    arm that holds it, or it (p)resses the lid shut, the lid (s)huts, the cube lies (o)n the other
    arm's hand or on the lid (c); as n, but the lid is down on the arm that brings the cube (g), and
    nobody else at it (G); S and F are i and f with a lid that shuts, A is f with an open lid and
    nobody at it, and d is f with the cube on the table.
    """
    task = next(task for task, one in CASES.items() if one is case)
    moments = Moments(TaskHarness(catalog.get(task)))
    keep, edit = moments.keep, moments.edit

    def honest(arms: Arms) -> Script:
        keep("t")
        yield from together(case.opens(arms), case.fetches(arms))
        yield from wait(10)
        keep("h")
        yield from case.comes_near(arms)
        keep("n")
        yield from case.puts_in(arms)
        keep("i")
        yield from release(arms, case.bringer, opening=LET_GO)
        yield from wait(15)
        keep("f")

    def without_holder(sim: Simulation) -> None:
        take_away(sim, case.holder, moments.states["t"])

    def shut(sim: Simulation) -> None:
        set_hinge(sim, case.lid, HALF_OPEN)

    def at_the_other_arm(sim: Simulation) -> None:
        pads = sim.body_id(f"{case.holder}/gripper/base")
        sim.place("cube", SE3(np.eye(3), sim.data.xpos[pads]))

    def on_the_lid(sim: Simulation) -> None:
        sim.place("cube", SE3(np.eye(3), sim.data.xipos[sim.body_id(case.lid)]))

    moments.start()
    start = moments.bench.sim.pose("cube")
    moments.bench.act(honest)
    edit("a", "h", without_holder)
    edit("p", "h", lambda sim: press_it_shut(sim, case))
    edit("s", "h", shut)
    edit("g", "n", lambda sim: lower_onto_the_arm(sim, case))
    edit("G", "g", without_holder)
    edit("o", "h", at_the_other_arm)
    edit("c", "h", on_the_lid)
    edit("S", "i", shut)
    edit("d", "f", lambda sim: sim.place("cube", start))
    edit("A", "f", without_holder)
    edit("F", "f", shut)
    return moments


def test_the_moments_are_what_they_shall_be(moments: Moments, case: Opening) -> None:
    contacts, at = moments.bench.sim.contacts, moments.at
    for letter in "hnif":
        assert at(letter).angle(case.lid) > 1.0, letter
        assert contacts.gripper(case.holder, case.lid), letter
        assert not contacts.arm(case.bringer, case.lid), letter
    assert not contacts.gripper(case.bringer, "cube")
    for letter in "hniagsS":
        at(letter)
        assert contacts.grasped(case.bringer, "cube"), letter
    for letter in "aA":
        assert at(letter).angle(case.lid) > 1.0
        assert not contacts.arm(case.holder, case.lid)
    assert at("g").angle(case.lid) >= OPEN
    assert contacts.arm(case.bringer, case.lid)
    at("c")
    assert contacts.between("cube", case.lid)
    at("o")
    assert contacts.arm(case.holder, "cube")
    assert not contacts.between("cube", case.lid)


def test_what_holds_a_lid_has_the_moment_of_its_weight_and_spring(
    moments: Moments, case: Opening
) -> None:
    sim, state = moments.bench.sim, moments.states["h"]
    lid, command = sim.model.joint(case.lid), sim.duo.command()
    sim.set_state(state)
    dof = lid.dofadr[0]
    needed = sim.data.qfrc_bias[dof] - sim.data.qfrc_passive[dof]
    sim.step(command)
    expected = sim.get_state()
    sim.set_state(state)
    moment = sim.contacts.moment(case.holder, case.lid, sim.hinge_axis(case.lid))
    assert moment == pytest.approx(needed, rel=0.1)
    assert sim.contacts.moment(case.bringer, case.lid, sim.hinge_axis(case.lid)) == 0.0
    sim.step(command)
    assert np.array_equal(sim.get_state(), expected)  # to ask changes nothing


LEFT_ALONE = "A" * REST
"""The cube rests inside, and nobody is at the lid: what counts then, counted when it was put in."""
HELD = "f" * (LONG + 1)
"""The cube rests inside, and the lid goes on being held."""
SUPPORTED, TOUCHED = "h" * LONG, "g" * (GRAZE - 1)

SEQUENCES = {
    "the honest way counts": (
        (0, "t"),
        (1, "t", "h"),
        (2, "t", SUPPORTED),
        (2, "t", SUPPORTED, "ni"),
        (2, "t", SUPPORTED, "ni", "f" * (REST - 1)),
        (3, "t", SUPPORTED, "ni", "f" * REST),
        (3, "t", SUPPORTED, "ni", LEFT_ALONE),
    ),
    "support needs the other arm at the lid": (
        (1, "a" * 2 * LONG),
        (1, "a" * 2 * LONG, LEFT_ALONE, HELD),
    ),
    "a touch that presses the lid shut is no support": (
        (1, "p" * 2 * LONG),
        (3, SUPPORTED, "p" * (LONG - 1), "gi", LEFT_ALONE),
        (2, SUPPORTED, "p" * LONG, "gi", LEFT_ALONE),
    ),
    "support needs the arm with the cube to leave the lid alone": (
        (1, "g" * 2 * LONG),
        (1, "g" * LONG, "n" * (LONG - 1)),
        (2, "g" * LONG, "n" * LONG),
        (1, ("n" * (LONG - 1) + "g") * 3),
    ),
    "support needs an open lid and a lifted cube": (
        (1, "s" * 2 * LONG),
        (1, "s" * 2 * LONG, "h" * (LONG - 1)),
        (1, "f" * 2 * LONG),
        (2, "f" * 2 * LONG, "n"),
    ),
    "a cube that came without support does not count": (
        (1, "f" * 2 * LONG),
        (1, "h" * (LONG - 1), HELD),
    ),
    "a cube that was not let go inside does not count": (
        # It flew in from a hand outside.
        (2, SUPPORTED, "d", HELD),
    ),
    "a lid that shut on the way spoils it": (
        (2, SUPPORTED, "s", "i", HELD),
        (2, SUPPORTED, "s", "i", "F" * REST),
        (3, SUPPORTED, "s", SUPPORTED, "i", HELD),
    ),
    "the arm with the cube may graze the lid but not hold it": (
        (3, SUPPORTED, TOUCHED, "i", LEFT_ALONE),
        (2, SUPPORTED, "g" * GRAZE, "i", LEFT_ALONE),
        (3, SUPPORTED, TOUCHED, "n", TOUCHED, "i", LEFT_ALONE),
    ),
    "the cube may not hold the lid either": (
        (3, SUPPORTED, "c" * (GRAZE - 1), "ni", LEFT_ALONE),
        (2, SUPPORTED, "c" * GRAZE, "ni", LEFT_ALONE),
    ),
    "the other arm may slip but not leave": (
        (3, SUPPORTED, "a" * (LONG - 1), "gi", LEFT_ALONE),
        (2, SUPPORTED, "a" * LONG, "gi", LEFT_ALONE),
    ),
    "a lid that is still held when the hand is gone was held": (
        (3, SUPPORTED, "g" * LONG, "i", HELD),
        (3, SUPPORTED, "c" * LONG, "ni", HELD),
        (3, SUPPORTED, "G" * (LONG - 1), "i", HELD),
        # Unless its holder was away for a while, or it shut in between, or shuts when the hand is
        # gone, or nobody is at it.
        (2, SUPPORTED, "G" * LONG, "i", HELD),
        (2, SUPPORTED, "g" * LONG, "s", "i", HELD),
        (2, SUPPORTED, "g" * LONG, "i", "F" * LONG, HELD),
        (2, SUPPORTED, "g" * LONG, "i", "A" * 2 * LONG),
    ),
    "only the arm that had the cube brings it": (
        (3, SUPPORTED, "o" * (GRAZE - 1), "gi", HELD),
        (2, SUPPORTED, "o" * GRAZE, "gi", HELD),
    ),
    "once the cube is inside the lid may fall": ((3, SUPPORTED, "i", "S" * 2 * LONG, "F" * REST),),
    "a cube that was taken out again must be brought again": (
        (2, SUPPORTED, "i", "s", "F" * REST),
        (2, SUPPORTED, "i", "h", "d", HELD),
        (3, SUPPORTED, "i", "h", "i", HELD),
    ),
}
"""The stage after moments."""


@pytest.mark.parametrize("rows", SEQUENCES.values(), ids=SEQUENCES)
def test_support(moments: Moments, rows: tuple[tuple, ...]) -> None:
    for stage, *letters in rows:
        assert moments.stage_after(*letters) == stage, letters


@pytest.mark.long
@pytest.mark.parametrize("level", range(LEVELS + 1))
def test_no_lid_stays_open_by_itself_for_long(moments: Moments, case: Opening, level: int) -> None:
    """Neither let go at its stop nor thrown open, from where it begins to count, at any speed, and
    whatever the physics of a level.
    """
    bench = moments.bench
    joint = bench.sim.model.joint(case.lid)
    heavy, tight = MASS_FACTORS[level], SPRING_FACTORS[level]
    corners = {(m, s) for m in (1 / heavy, 1.0, heavy) for s in (1 / tight, 1.0, tight)}
    try:
        for mass, spring in corners if level else {(1.0, 1.0)}:
            bench.sim.scaler.apply(mass=mass, spring=spring)
            bench.start(0)
            for speed in (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0):
                set_hinge(bench.sim, case.lid, joint.range[1] if speed == 0 else OPEN, speed)
                bench.hold(LONG - 2)
                assert bench.sim.angle(case.lid) < OPEN, (mass, spring, speed)
    finally:
        bench.sim.scaler.apply()
