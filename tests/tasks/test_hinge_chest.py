import math

import numpy as np
import pytest

from duobench.experts.hinge_chest import script
from duobench.experts.motion import Arms, Script, move, release, wait
from duobench.solids.blocks import CUBE_EDGE
from duobench.solids.chest import LID_LIMITS, OUTER_Y, RIM_HEIGHT, WALL
from duobench.spatial import SE3
from duobench.tasks.hinge_chest import OPEN_ANGLE, TASK
from duobench.types import Side
from tests.stageplay import Stageplay

LID = "chest/lid"
HALF = CUBE_EDGE / 2
ON_FLOOR = WALL + HALF
STEPS_TO_STAGE_2 = 110
"""Control steps in which the expert has the cube in the air and the lid open."""
STEPS_TO_DROP = 144
"""Control steps in which the expert has the cube in the open chest, still pinched."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


def in_chest(bench: Stageplay, x: float, y: float, z: float) -> SE3:
    return bench.sim.pose("chest") @ SE3.at(x, y, z)


def set_lid(bench: Stageplay, angle: float) -> None:
    joint = bench.sim.model.joint(LID)
    bench.sim.data.qpos[joint.qposadr[0]] = angle
    bench.sim.data.qvel[joint.dofadr[0]] = 0.0
    bench.sim.refresh()


def let_the_lid_go(arms: Arms) -> Script:
    """Draw the fingers out along themselves."""
    back = arms.targets[Side.RIGHT] @ SE3.at(z=-0.12)
    yield from move(arms, {Side.RIGHT: back})
    yield from wait(30)


def after_stage_2(bench: Stageplay) -> None:
    """An episode in which lid and cube were held, the lid is shut again, the cube lies aside."""
    bench.start(0)
    assert bench.run_for(script, STEPS_TO_STAGE_2) == 2
    bench.act(lambda arms: release(arms, Side.LEFT))
    bench.put(cube=SE3.at(0.45, 0.35, HALF))
    bench.act(let_the_lid_go)
    assert bench.sim.angle(LID) < 0.01
    assert bench.stage == 2


@pytest.mark.parametrize("seed", [3, 17])
def test_the_expert_passes_the_stages_in_order(bench: Stageplay, seed: int) -> None:
    bench.start(seed)
    assert bench.run_for(script, TASK.horizon) == 3
    assert bench.history == sorted(bench.history)
    assert set(bench.history) == {0, 1, 2, 3}
    assert bench.progress.final_holds


# --- what must not count -------------------------------------------------------------------------


def test_a_cube_on_top_of_the_shut_lid_does_not_count(bench: Stageplay) -> None:
    after_stage_2(bench)
    bench.put(cube=in_chest(bench, 0.0, 0.0, RIM_HEIGHT + WALL + 0.002 + HALF))
    assert bench.hold(20) == 2
    assert bench.sim.contacts.between("cube", LID)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_cube_beside_the_chest_does_not_count(bench: Stageplay, side: int) -> None:
    after_stage_2(bench)
    beside = in_chest(bench, 0.0, side * (OUTER_Y / 2 + HALF - 0.0002), HALF)
    bench.put(cube=beside)
    assert bench.sim.contacts.between("cube", "chest")
    assert bench.hold(20) == 2


def test_a_cube_across_the_rim_does_not_count(bench: Stageplay) -> None:
    after_stage_2(bench)
    set_lid(bench, LID_LIMITS[1])
    on_rim = OUTER_Y / 2 - WALL - 0.001
    bench.put(cube=in_chest(bench, 0.0, on_rim, RIM_HEIGHT + HALF - 0.0002))
    assert bench.sim.contacts.between("cube", "chest")
    assert bench.stage == 2


def test_a_cube_in_the_chest_counts_once_it_is_let_go(bench: Stageplay) -> None:
    bench.start(0)
    bench.run_for(script, STEPS_TO_DROP)

    def press(arms: Arms) -> Script:
        yield from move(arms, {Side.LEFT: arms.targets[Side.LEFT].moved(z=-0.012)})
        yield from wait(5)

    assert bench.act(press) == 2
    assert bench.sim.contacts.between("cube", "chest")
    assert bench.sim.contacts.pads(Side.LEFT, "cube")
    assert bench.act(lambda arms: release(arms, Side.LEFT, opening=0.75)) == 3


def test_a_cube_that_was_never_held_over_an_open_chest_does_not_count(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(cube=in_chest(bench, 0.0, 0.0, ON_FLOOR))
    assert bench.hold(20) == 0
    set_lid(bench, LID_LIMITS[1])
    assert bench.judge() == 1
    assert bench.hold(30) == 1


def test_a_cube_that_was_held_over_the_open_chest_counts_inside(bench: Stageplay) -> None:
    after_stage_2(bench)
    bench.put(cube=in_chest(bench, 0.0, 0.0, ON_FLOOR))
    assert bench.hold(5) == 3


def test_a_lid_that_is_open_by_too_little_does_not_count(bench: Stageplay) -> None:
    bench.start(0)
    set_lid(bench, OPEN_ANGLE - 0.01)
    assert bench.judge() == 0
    set_lid(bench, OPEN_ANGLE + 0.01)
    assert bench.judge() == 1


# --- physics and objects -------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.2, OPEN_ANGLE, 1.2, LID_LIMITS[1]])
def test_the_lid_falls_shut_within_a_second(bench: Stageplay, angle: float) -> None:
    bench.start(0)
    set_lid(bench, angle)
    bench.hold(1)
    assert 0.01 < bench.sim.angle(LID) < angle
    bench.hold(29)
    assert bench.sim.angle(LID) < 0.01


def test_the_spring_pulls_as_the_task_says(bench: Stageplay) -> None:
    """Half a newton metre per radian towards shut, and none where the lid is shut."""
    bench.start(0)
    joint = bench.sim.model.joint(LID)
    assert joint.stiffness[0] == 0.5
    for angle in (0.0, 0.4, 0.8, 1.55):
        set_lid(bench, angle)
        assert bench.sim.data.qfrc_spring[joint.dofadr[0]] == pytest.approx(-0.5 * angle)


def test_the_spring_shuts_a_lid_that_stands_nearly_upright(bench: Stageplay) -> None:
    """There its weight has no lever: without a spring it would take most of a second."""
    bench.start(0)
    set_lid(bench, 1.55)
    weight = bench.sim.data.qfrc_bias[bench.sim.model.joint(LID).dofadr[0]]
    assert abs(weight) < 0.02
    bench.hold(6)
    assert bench.sim.angle(LID) < 0.8
    bench.hold(24)
    assert bench.sim.angle(LID) < 0.01


def test_the_lid_shuts_on_its_own_when_the_arm_draws_back(bench: Stageplay) -> None:
    bench.start(0)
    bench.run_for(script, STEPS_TO_STAGE_2)
    assert bench.sim.angle(LID) > OPEN_ANGLE
    bench.act(let_the_lid_go)
    assert bench.sim.angle(LID) < 0.01


def test_the_lid_clears_the_chest_at_every_angle(bench: Stageplay) -> None:
    bench.start(0)
    for angle in np.linspace(*LID_LIMITS, 20):
        set_lid(bench, float(angle))
        assert not bench.sim.contacts.between(LID, "chest")


def test_the_cavity_is_empty_and_as_large_as_the_task_says(bench: Stageplay) -> None:
    bench.start(0)
    inset = HALF + 0.0005
    for x in (-0.065 + inset, 0.065 - inset):
        for y in (-0.115 + inset, 0.115 - inset):
            for z in (ON_FLOOR + 0.0005, RIM_HEIGHT - inset):
                bench.put(cube=in_chest(bench, x, y, z))
                assert bench.sim.contacts.partners("cube") == set()
    bench.put(cube=in_chest(bench, 0.065 - HALF + 0.001, 0.0, ON_FLOOR))
    assert bench.sim.contacts.between("cube", "chest")


def test_objects_rest_apart_at_reset(bench: Stageplay) -> None:
    for seed in range(10):
        layout = bench.start(seed)
        assert bench.sim.contacts.deepest(0.0005) == []
        assert bench.sim.contacts.partners("cube") == {"table"}
        assert bench.sim.angle(LID) == pytest.approx(0.0, abs=0.005)
        moved, turned = bench.sim.pose("cube").distance(layout.poses["cube"])
        assert moved < 0.001
        assert turned < 0.01
        assert bench.hold(5) == 0
        assert np.max(bench.sim.speed("cube")) < 0.005
        assert abs(layout.poses["chest"].yaw) <= math.radians(10)
