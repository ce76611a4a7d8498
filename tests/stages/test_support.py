"""Support as sequences of moments, most of which two arms really brought about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from duobench.experts.handling import LET_GO
from duobench.experts.motion import Arms, Script, release, together, wait
from duobench.sim.simulation import Simulation
from duobench.spatial import SE3
from duobench.stages.placing import REST_SECONDS
from duobench.stages.predicates import FLICKER_SECONDS
from duobench.stages.support import UNSUPPORTED_SECONDS
from duobench.tasks import catalog
from duobench.types import CONTROL_HZ
from tests.task_harness import TaskHarness, set_hinge, take_away
from tests.ways.hinge_chest import CHEST
from tests.ways.opening import Opening
from tests.ways.spring_door import DOOR

LONG = round(UNSUPPORTED_SECONDS * CONTROL_HZ)
GRAZE = round(FLICKER_SECONDS * CONTROL_HZ)
REST = round(REST_SECONDS * CONTROL_HZ)
OPEN, HALF_OPEN = 0.8, 0.79


CASES = {"hinge_chest": CHEST, "spring_door": DOOR}


@dataclass(frozen=True)
class Scene:
    """A task on the bench, and states of it by letter."""

    bench: TaskHarness
    case: Opening
    states: dict[str, np.ndarray]

    def stage_after(self, *letters: str) -> int:
        """The stage after a sequence of moments."""
        self.bench.start(0)
        for letter in "".join(letters):
            self.bench.sim.set_state(self.states[letter])
            self.bench.judge()
        return self.bench.stage


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
        pushes = contacts.pushes(case.holder, case.lid, sim.hinge_axis(case.lid))
        grasps = contacts.grasped(case.holder, case.lid)
        if contacts.arm(case.holder, case.lid) and not (pushes or grasps):
            return
    pytest.fail("no such angle")


def collect(bench: TaskHarness, case: Opening) -> dict[str, np.ndarray]:
    """States by letter.

    What two arms did: (t) at the start; the lid held open and the cube (h)eld, come (n)ear,
    (i)nside but pinched, (f)ree inside. What is made of that: as h, but (a)way from the lid is the
    arm that holds it, or it (p)resses the lid shut, the lid (s)huts, the cube lies (o)n the other
    arm's hand or on the lid (c); as n, but the lid is down on the arm that brings the cube (g), and
    nobody else at it (G); S and F are i and f with a lid that shuts, A is f with an open lid and
    nobody at it, and d is f with the cube on the table.
    """
    sim, saved = bench.sim, dict[str, np.ndarray]()

    def keep(letter: str) -> None:
        saved[letter] = sim.get_state()

    def edit(letter: str, base: str, change: Callable[[], Any]) -> None:
        sim.set_state(saved[base])
        change()
        keep(letter)

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

    def at_the_other_arm() -> None:
        pads = sim.body_id(f"{case.holder}/gripper/base")
        sim.place("cube", SE3(np.eye(3), sim.data.xpos[pads]))
        sim.forward()

    def on_the_lid() -> None:
        sim.place("cube", SE3(np.eye(3), sim.data.xipos[sim.body_id(case.lid)]))
        sim.forward()

    def on_the_table() -> None:
        sim.place("cube", start)
        sim.forward()

    bench.start(0)
    start = sim.pose("cube")
    bench.act(honest)
    edit("a", "h", lambda: take_away(sim, case.holder, saved["t"]))
    edit("p", "h", lambda: press_it_shut(sim, case))
    edit("s", "h", lambda: set_hinge(sim, case.lid, HALF_OPEN))
    edit("g", "n", lambda: lower_onto_the_arm(sim, case))
    edit("G", "g", lambda: take_away(sim, case.holder, saved["t"]))
    edit("o", "h", at_the_other_arm)
    edit("c", "h", on_the_lid)
    edit("S", "i", lambda: set_hinge(sim, case.lid, HALF_OPEN))
    edit("d", "f", on_the_table)
    edit("A", "f", lambda: take_away(sim, case.holder, saved["t"]))
    edit("F", "f", lambda: set_hinge(sim, case.lid, HALF_OPEN))
    return saved


@pytest.fixture(scope="module", params=CASES)
def scene(request: pytest.FixtureRequest) -> Scene:
    bench, case = TaskHarness(catalog.get(request.param)), CASES[request.param]
    return Scene(bench, case, collect(bench, case))


def test_the_moments_are_what_they_shall_be(scene: Scene) -> None:
    case, sim = scene.case, scene.bench.sim
    contacts = sim.contacts

    def at(letter: str) -> Simulation:
        sim.set_state(scene.states[letter])
        return sim

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


LEFT_ALONE = "A" * REST
"""The cube rests inside, and nobody is at the lid: what counts then, counted when it was put in."""
HELD = "f" * (LONG + 1)
"""The cube rests inside, and the lid goes on being held."""


def test_the_honest_way_counts(scene: Scene) -> None:
    assert scene.stage_after("t") == 0
    assert scene.stage_after("t", "h") == 1
    assert scene.stage_after("t", "h" * LONG) == 2
    assert scene.stage_after("t", "h" * LONG, "ni") == 2
    assert scene.stage_after("t", "h" * LONG, "ni", "f" * (REST - 1)) == 2
    assert scene.stage_after("t", "h" * LONG, "ni", "f" * REST) == 3
    assert scene.stage_after("t", "h" * LONG, "ni", LEFT_ALONE) == 3


def test_support_needs_the_other_arm_at_the_lid(scene: Scene) -> None:
    assert scene.stage_after("a" * 2 * LONG) == 1
    assert scene.stage_after("a" * 2 * LONG, LEFT_ALONE, HELD) == 1


def test_a_touch_that_presses_the_lid_shut_is_no_support(scene: Scene) -> None:
    assert scene.stage_after("p" * 2 * LONG) == 1
    assert scene.stage_after("h" * LONG, "p" * (LONG - 1), "gi", LEFT_ALONE) == 3
    assert scene.stage_after("h" * LONG, "p" * LONG, "gi", LEFT_ALONE) == 2


def test_support_needs_the_arm_with_the_cube_to_leave_the_lid_alone(scene: Scene) -> None:
    assert scene.stage_after("g" * 2 * LONG) == 1
    assert scene.stage_after("g" * LONG, "n" * (LONG - 1)) == 1
    assert scene.stage_after("g" * LONG, "n" * LONG) == 2
    assert scene.stage_after(("n" * (LONG - 1) + "g") * 3) == 1


def test_support_needs_an_open_lid_and_a_lifted_cube(scene: Scene) -> None:
    assert scene.stage_after("s" * 2 * LONG) == 1
    assert scene.stage_after("s" * 2 * LONG, "h" * (LONG - 1)) == 1
    assert scene.stage_after("f" * 2 * LONG) == 1
    assert scene.stage_after("f" * 2 * LONG, "n") == 2


def test_a_cube_that_came_without_support_does_not_count(scene: Scene) -> None:
    assert scene.stage_after("f" * 2 * LONG) == 1
    assert scene.stage_after("h" * (LONG - 1), HELD) == 1


def test_a_cube_that_was_not_let_go_inside_does_not_count(scene: Scene) -> None:
    """It flew in from a hand outside."""
    assert scene.stage_after("h" * LONG, "d", HELD) == 2


def test_a_lid_that_shut_on_the_way_spoils_it(scene: Scene) -> None:
    assert scene.stage_after("h" * LONG, "s", "i", HELD) == 2
    assert scene.stage_after("h" * LONG, "s", "i", "F" * REST) == 2
    assert scene.stage_after("h" * LONG, "s", "h" * LONG, "i", HELD) == 3


def test_the_arm_with_the_cube_may_graze_the_lid_but_not_hold_it(scene: Scene) -> None:
    graze = "g" * (GRAZE - 1)
    assert scene.stage_after("h" * LONG, graze, "i", LEFT_ALONE) == 3
    assert scene.stage_after("h" * LONG, "g" * GRAZE, "i", LEFT_ALONE) == 2
    assert scene.stage_after("h" * LONG, graze, "n", graze, "i", LEFT_ALONE) == 3


def test_the_cube_may_not_hold_the_lid_either(scene: Scene) -> None:
    assert scene.stage_after("h" * LONG, "c" * (GRAZE - 1), "ni", LEFT_ALONE) == 3
    assert scene.stage_after("h" * LONG, "c" * GRAZE, "ni", LEFT_ALONE) == 2


def test_the_other_arm_may_slip_but_not_leave(scene: Scene) -> None:
    assert scene.stage_after("h" * LONG, "a" * (LONG - 1), "gi", LEFT_ALONE) == 3
    assert scene.stage_after("h" * LONG, "a" * LONG, "gi", LEFT_ALONE) == 2


def test_a_lid_that_is_still_held_when_the_hand_is_gone_was_held(scene: Scene) -> None:
    assert scene.stage_after("h" * LONG, "g" * LONG, "i", HELD) == 3
    assert scene.stage_after("h" * LONG, "c" * LONG, "ni", HELD) == 3
    assert scene.stage_after("h" * LONG, "G" * (LONG - 1), "i", HELD) == 3
    # Unless its holder was away for a while, or it shut in between, or shuts when the hand is gone,
    # or nobody is at it.
    assert scene.stage_after("h" * LONG, "G" * LONG, "i", HELD) == 2
    assert scene.stage_after("h" * LONG, "g" * LONG, "s", "i", HELD) == 2
    assert scene.stage_after("h" * LONG, "g" * LONG, "i", "F" * LONG, HELD) == 2
    assert scene.stage_after("h" * LONG, "g" * LONG, "i", "A" * 2 * LONG) == 2


def test_only_the_arm_that_had_the_cube_brings_it(scene: Scene) -> None:
    assert scene.stage_after("h" * LONG, "o" * (GRAZE - 1), "gi", HELD) == 3
    assert scene.stage_after("h" * LONG, "o" * GRAZE, "gi", HELD) == 2


def test_once_the_cube_is_inside_the_lid_may_fall(scene: Scene) -> None:
    assert scene.stage_after("h" * LONG, "i", "S" * 2 * LONG, "F" * REST) == 3


def test_a_cube_that_was_taken_out_again_must_be_brought_again(scene: Scene) -> None:
    assert scene.stage_after("h" * LONG, "i", "s", "F" * REST) == 2
    assert scene.stage_after("h" * LONG, "i", "h", "d", HELD) == 2
    assert scene.stage_after("h" * LONG, "i", "h", "i", HELD) == 3


def test_no_lid_stays_open_by_itself_for_long(scene: Scene) -> None:
    """Neither let go at its stop nor thrown open, from where it begins to count, at any speed."""
    bench, lid = scene.bench, scene.case.lid
    joint = bench.sim.model.joint(lid)
    bench.start(0)
    for speed in np.arange(0.0, 32.0, 2.0):
        set_hinge(bench.sim, lid, joint.range[1] if speed == 0 else OPEN, speed)
        bench.hold(LONG - 2)
        assert bench.sim.angle(lid) < OPEN, speed
