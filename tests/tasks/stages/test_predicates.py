"""Each word that stages are written in, on small scenes that were built for it."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from duobench.core.errors import UnknownNameError
from duobench.core.spatial import SE3
from duobench.core.types import SIDES, DuoCommand, Side
from duobench.tasks.stages.logic import Predicate, StateView, all_of, any_of, held_for
from duobench.tasks.stages.predicates import (
    BoxRegion,
    CylinderRegion,
    at_least,
    grasped,
    hinge_open,
    inside,
    lifted,
    lifted_by_any,
    off_table,
    raised,
    released,
    rests_on,
    still,
    touches,
    touching,
    upright,
    variant,
)
from duobench.world.robot.frames import ROBOT
from duobench.world.scene.naming import TABLE, tcp_name
from duobench.world.sim.simulation import Simulation
from tests.world.sim.props import EDGE, LID, scene

REST = {
    "cube": SE3.at(0.5, 0.1, EDGE / 2),
    "slab": SE3.at(0.5, -0.2, 0.01),
    "bowl": SE3.at(0.7, 0.3),
    "chest": SE3.at(0.7, -0.3),
}
CLOSED_LEFT = DuoCommand(joints=ROBOT.home_command.joints, openings=np.array([0.0, 1.0]))


@pytest.fixture(scope="module")
def shared() -> Simulation:
    return scene()


@pytest.fixture
def sim(shared: Simulation) -> Simulation:
    shared.reset_data()
    put(shared, **REST)
    shared.settle()
    return shared


def put(sim: Simulation, **poses: SE3) -> None:
    for name, pose in poses.items():
        sim.place(name, pose)
    sim.forward()


def gripped(sim: Simulation) -> None:
    """The left gripper closes in the air on the cube."""
    tool = sim.site_pose(tcp_name(Side.LEFT))
    for _ in range(15):
        put(sim, cube=tool)
        sim.step(CLOSED_LEFT)
    for _ in range(5):
        sim.step(CLOSED_LEFT)


def moment(sim: Simulation, **changes: object) -> StateView:
    fields: dict[str, object] = {
        "simulation": sim,
        "start_heights": dict.fromkeys(sim.props, 0.0),
        "variants": {},
        "remembered": frozenset(),
    }
    return StateView(**fields | changes)  # type: ignore[arg-type]


def holds(predicate: Predicate, sim: Simulation, **changes: object) -> bool:
    return predicate(moment(sim, **changes))


def constant(*, value: bool) -> Predicate:
    return Predicate(str(value), lambda _: value)


# --- logic ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("a", "b"), list(itertools.product([False, True], repeat=2)))
def test_combinations_are_logic(sim: Simulation, a: bool, b: bool) -> None:
    one, other = constant(value=a), constant(value=b)
    assert holds(one & other, sim) is (a and b)
    assert holds(one | other, sim) is (a or b)
    assert holds(~one, sim) is (not a)
    assert holds(all_of(), sim)
    assert not holds(any_of(), sim)
    assert holds(all_of(one, other, one), sim) is (a and b)
    assert holds(any_of(one, other, one), sim) is (a or b)


def test_a_predicate_is_tested_once_a_moment(sim: Simulation) -> None:
    asked = []
    base = Predicate("base", lambda m: asked.append(m) or True)  # type: ignore[func-returns-value]
    now = moment(sim)
    assert (base & base)(now)
    assert (base | ~base)(now)
    assert len(asked) == 1
    base(moment(sim))
    assert len(asked) == 2


def test_parts_come_before_what_they_make_and_only_once() -> None:
    one, other = constant(value=True), constant(value=False)
    both = one & other
    whole = both | ~one
    walked = list(whole.walk())
    assert len(walked) == len(set(walked)) == 5
    for predicate in walked:
        assert all(walked.index(part) < walked.index(predicate) for part in predicate.parts)


def test_predicates_read_as_sentences() -> None:
    predicate = touches(Side.LEFT, "cube") & ~raised("cube", 0.03)
    assert repr(predicate) == "(left touches cube and not cube is raised by 30 mm)"


# --- contact -------------------------------------------------------------------------------------


def test_at_rest_nobody_holds_anything(sim: Simulation) -> None:
    for side in SIDES:
        assert not holds(touches(side, "cube"), sim)
        assert not holds(grasped(side, "cube"), sim)
        assert not holds(lifted(side, "cube"), sim)
    assert holds(released("cube"), sim)
    assert not holds(lifted_by_any("cube"), sim)
    assert holds(touching("cube", TABLE), sim)
    assert not holds(off_table("cube"), sim)


def test_a_gripped_cube_is_held_by_that_arm_alone(sim: Simulation) -> None:
    gripped(sim)
    for word in (touches, grasped, lifted):
        assert holds(word(Side.LEFT, "cube"), sim)
        assert not holds(word(Side.RIGHT, "cube"), sim)
    assert holds(lifted_by_any("cube"), sim)
    assert holds(off_table("cube"), sim)
    assert not holds(released("cube"), sim)


def test_held_needs_ten_millimetres(sim: Simulation) -> None:
    gripped(sim)
    lowest = sim.min_height("cube")
    assert holds(lifted(Side.LEFT, "cube"), sim, start_heights={"cube": lowest - 0.0101})
    assert not holds(lifted(Side.LEFT, "cube"), sim, start_heights={"cube": lowest - 0.0099})


def test_clear_means_all_supports(sim: Simulation) -> None:
    put(sim, cube=SE3.at(0.5, -0.2, 0.02 + EDGE / 2 - 0.0001))
    assert holds(off_table("cube"), sim)
    assert not holds(off_table("cube", "slab"), sim)
    assert not holds(off_table("slab", "chest"), sim)
    assert holds(touching("slab", "cube"), sim)


def test_a_touch_of_the_palm_is_a_touch_and_no_pinch(sim: Simulation) -> None:
    tool = sim.site_pose(tcp_name(Side.RIGHT))
    put(sim, cube=tool @ SE3.at(0.0, 0.0, -0.05))
    assert holds(touches(Side.RIGHT, "cube"), sim)
    assert not holds(grasped(Side.RIGHT, "cube"), sim)
    assert not holds(released("cube"), sim)


# --- place and motion ----------------------------------------------------------------------------


def test_raised_is_about_the_lowest_point(sim: Simulation) -> None:
    put(sim, slab=SE3.at(0.5, -0.2, 0.04) @ SE3.about((0, 1, 0), 0.5))
    lowest = sim.min_height("slab")
    assert lowest < 0.04 - 0.02
    assert holds(raised("slab", 0.01), sim, start_heights={"slab": lowest - 0.0101})
    assert not holds(raised("slab", 0.01), sim, start_heights={"slab": lowest - 0.0099})


@pytest.mark.parametrize(
    ("velocity", "expected"),
    [
        ([0.0] * 6, True),
        ([0.049, 0, 0, 0.49, 0, 0], True),
        ([0.051, 0, 0, 0, 0, 0], False),
        ([0, 0, 0, 0, 0.51, 0], False),
        ([0.04, 0.04, 0, 0, 0, 0], False),
    ],
)
def test_still(sim: Simulation, velocity: list[float], expected: bool) -> None:
    put(sim, cube=REST["cube"])
    start = sim.model.joint("cube").dofadr[0]
    sim.data.qvel[start : start + 6] = velocity
    assert holds(still("cube"), sim) is expected


@pytest.mark.parametrize(
    ("lean", "expected"), [(0.0, True), (9.9, True), (10.1, False), (180, False)]
)
def test_upright(sim: Simulation, lean: float, expected: bool) -> None:
    put(sim, slab=SE3.at(0.5, -0.2, 0.3, yaw=1.0) @ SE3.about((1, 1, 0), math.radians(lean)))
    assert holds(upright("slab", math.radians(10)), sim) is expected


def test_hinge_open(sim: Simulation) -> None:
    sim.data.qpos[sim.model.joint(LID).qposadr[0]] = 0.8
    assert holds(hinge_open(LID, 0.79), sim)
    assert not holds(hinge_open(LID, 0.81), sim)


def test_rests_on(sim: Simulation) -> None:
    on_slab = SE3.at(0.5, -0.2, 0.02 + EDGE / 2)
    put(sim, cube=on_slab)
    sim.settle()
    assert holds(rests_on("cube", "slab"), sim)
    assert not holds(rests_on("cube", "bowl"), sim)
    assert not holds(rests_on("slab", "cube"), sim), "the slab also lies on the table"
    start = sim.model.joint("cube").dofadr[0]
    sim.data.qvel[start] = 0.2
    assert not holds(rests_on("cube", "slab"), sim)


def test_variant(sim: Simulation) -> None:
    assert holds(variant("full", "left"), sim, variants={"full": "left"})
    assert not holds(variant("full", "left"), sim, variants={"full": "right"})
    assert not holds(variant("full", "left"), sim)


# --- regions -------------------------------------------------------------------------------------

BOX = BoxRegion(body="bowl", low=(-0.05, -0.02, 0.0), high=(0.05, 0.02, 0.10))
CYLINDER = CylinderRegion(body="bowl", radius=0.05, low=0.0, high=0.10, centre=(0.02, 0.0))


@pytest.mark.parametrize("region", [BOX, CYLINDER], ids=["box", "cylinder"])
def test_a_region_turns_and_moves_with_its_body(
    sim: Simulation, region: BoxRegion | CylinderRegion
) -> None:
    rng = np.random.default_rng(0)
    body = SE3.at(0.6, 0.2, 0.4, yaw=0.8) @ SE3.about((1, 0, 0), 0.6)
    put(sim, bowl=body)
    answers = []
    for point in rng.uniform(-0.12, 0.12, size=(80, 3)):
        put(sim, cube=SE3(np.eye(3), body.apply(point)))
        expected = region.contains(tuple(point.tolist()))
        assert holds(inside("cube", region), sim) is expected
        answers.append(expected)
    assert 0 < sum(answers) < len(answers)


def test_the_bounds_of_regions() -> None:
    for inner in ((0.05, 0.02, 0.10), (-0.05, -0.02, 0.0), (0.0, 0.0, 0.05)):
        assert BOX.contains(inner)
    for outer in ((0.051, 0, 0.05), (0, 0.021, 0.05), (0, 0, -0.001), (0, 0, 0.101)):
        assert not BOX.contains(outer)
    for inner in ((0.0699, 0.0, 0.05), (-0.0299, 0.0, 0.0), (0.02, 0.0499, 0.10)):
        assert CYLINDER.contains(inner)
    for outer in ((0.071, 0, 0.05), (-0.031, 0, 0.05), (0.02, 0, -0.001), (0.05, 0.045, 0.05)):
        assert not CYLINDER.contains(outer)


def test_counting_what_is_inside(sim: Simulation) -> None:
    region = BoxRegion(body="chest", low=(-0.1, -0.1, 0.0), high=(0.1, 0.1, 0.5))
    names = ["cube", "slab", "bowl"]
    members = [inside(name, region) for name in names]
    for count in range(4):
        put(sim, **REST)
        for name in names[:count]:
            put(sim, **{name: SE3.at(0.7, -0.3, 0.3)})
        answers = [holds(at_least(asked, *members), sim) for asked in range(4)]
        assert answers == [asked <= count for asked in range(4)]


# --- names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "predicate",
    [
        touches(Side.LEFT, "cbue"),
        grasped(Side.LEFT, "cbue"),
        off_table("cube", "cbue"),
        released("cbue"),
        inside("cube", BoxRegion(body="cbue", low=(0, 0, 0), high=(1, 1, 1))),
        upright("cbue", 0.1),
        hinge_open("cbue", 0.1),
    ],
    ids=repr,
)
def test_a_misspelt_name_is_an_error(sim: Simulation, predicate: Predicate) -> None:
    put(sim, cube=SE3.at(0.5, 0.1, 0.3))
    with pytest.raises(UnknownNameError, match="'cbue'"):
        holds(predicate, sim)


def test_equal_questions_are_one_predicate_that_a_step_asks_once() -> None:
    left, cube = Side.LEFT, "cube"
    one, other = (~grasped(left, cube) & lifted(left, cube, TABLE) for _ in range(2))
    assert one is other
    assert grasped(left, cube) is not grasped(left.other, cube)
    asked = list((one | held_for(other, 0.5)).walk())
    assert [part.name for part in asked].count("left grasps cube") == 1
