import numpy as np
import pytest

from duobench.experts.handling import LET_GO
from duobench.experts.motion import Arms, Script, move, release, together, wait
from duobench.experts.scripts.hinge_chest import HOLDER, INSERTER, fetch, lower, open_lid, script
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.chest import LID_LIMITS, OUTER_Y, RIM_HEIGHT, WALL
from duobench.spatial import SE3
from duobench.stages.placing import REST_SECONDS
from duobench.tasks.hinge_chest import OPEN_ANGLE, TASK
from duobench.types import CONTROL_HZ
from tests.task_harness import TaskHarness

LID = "chest/lid"
HALF = CUBE_EDGE / 2
REST_STEPS = round(REST_SECONDS * CONTROL_HZ)
ON_FLOOR = WALL + HALF - 0.0001
"""Height of a cube that touches the chest's floor."""


@pytest.fixture(scope="module")
def bench() -> TaskHarness:
    return TaskHarness(TASK)


def in_chest(bench: TaskHarness, x: float, y: float, z: float) -> SE3:
    return bench.sim.pose("chest") @ SE3.at(x, y, z)


def set_lid(bench: TaskHarness, angle: float) -> None:
    joint = bench.sim.model.joint(LID)
    bench.sim.data.qpos[joint.qposadr[0]] = angle
    bench.sim.data.qvel[joint.dofadr[0]] = 0.0
    bench.sim.forward()


def let_the_lid_go(arms: Arms) -> Script:
    """Draw the fingers out along themselves."""
    yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=-0.12)})
    yield from wait(30)


def lid_held_cube_aside(bench: TaskHarness) -> None:
    """An episode after stage 2: the right arm holds the lid, the cube lies aside."""
    bench.start(0)
    bench.reach(script, 2)
    bench.act(lambda arms: release(arms, INSERTER))
    bench.put(cube=SE3.at(0.45, 0.35, HALF))
    assert bench.sim.angle(LID) > OPEN_ANGLE
    assert bench.stage == 2


def cube_pressed_on_the_floor(bench: TaskHarness) -> None:
    """An episode in which the left arm has the cube on the chest's floor, still pinched."""

    def press(arms: Arms) -> Script:
        yield from together(open_lid(arms), fetch(arms))
        yield from lower(arms)
        yield from move(arms, {INSERTER: arms.targets[INSERTER].moved(z=-0.012)})
        yield from wait(10)

    bench.start(0)
    bench.act(press)
    assert bench.sim.contacts.between("cube", "chest")
    assert bench.sim.contacts.grasped(INSERTER, "cube")


@pytest.mark.parametrize("seed", [3, 17])
def test_the_expert_passes_the_stages_in_order(bench: TaskHarness, seed: int) -> None:
    bench.start(seed)
    assert bench.run_for(script, TASK.horizon) == 3
    assert bench.history == sorted(bench.history)
    assert set(bench.history) == {0, 1, 2, 3}
    assert bench.progress.final_holds


def test_what_the_expert_leaves_counts_and_goes_on_counting(bench: TaskHarness) -> None:
    bench.start(0)
    bench.act(script)
    assert bench.hold(REST_STEPS) == 3
    assert bench.progress.final_holds
    bench.act(let_the_lid_go)
    bench.hold(30)
    assert bench.progress.final_holds


def test_the_expert_holds_the_lid_with_its_gripper_clear_of_the_stop(bench: TaskHarness) -> None:
    bench.start(0)
    highest = 0.0
    for stage in bench.steps(script):
        highest = max(highest, bench.sim.angle(LID))
        if stage == 2:
            assert bench.sim.contacts.gripper(HOLDER, LID)
            assert not bench.sim.contacts.arm(INSERTER, LID)
    assert highest < LID_LIMITS[1] - 0.02


# --- what must not count -------------------------------------------------------------------------


def test_a_cube_on_top_of_the_shut_lid_does_not_count(bench: TaskHarness) -> None:
    lid_held_cube_aside(bench)
    bench.act(let_the_lid_go)
    assert bench.sim.angle(LID) < 0.01
    bench.put(cube=in_chest(bench, 0.0, 0.0, RIM_HEIGHT + WALL + 0.002 + HALF))
    assert bench.hold(20) == 2
    assert bench.sim.contacts.between("cube", LID)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_cube_beside_the_chest_does_not_count(bench: TaskHarness, side: int) -> None:
    lid_held_cube_aside(bench)
    beside = in_chest(bench, 0.0, side * (OUTER_Y / 2 + HALF - 0.0002), HALF)
    bench.put(cube=beside)
    assert bench.sim.contacts.between("cube", "chest")
    assert bench.hold(20) == 2


def test_a_cube_across_the_rim_does_not_count(bench: TaskHarness) -> None:
    lid_held_cube_aside(bench)
    on_rim = OUTER_Y / 2 - WALL - 0.001
    across = in_chest(bench, 0.0, on_rim, RIM_HEIGHT + HALF - 0.0002)
    bench.put(cube=in_chest(bench, 0.0, 0.0, ON_FLOOR))
    for _ in range(2 * REST_STEPS):
        bench.put(cube=across)
        assert bench.sim.contacts.between("cube", "chest")
        assert bench.stage == 2


def test_a_cube_in_the_chest_counts_once_it_is_let_go(bench: TaskHarness) -> None:
    cube_pressed_on_the_floor(bench)
    assert bench.stage == 2
    bench.act(lambda arms: release(arms, INSERTER, opening=LET_GO))
    assert bench.hold(REST_STEPS) == 3


def test_a_cube_on_its_way_out_does_not_count(bench: TaskHarness) -> None:
    cube_pressed_on_the_floor(bench)
    bench.act(lambda arms: move(arms, {INSERTER: arms.targets[INSERTER].moved(z=0.12)}))
    assert bench.hold(10) == 2


def cube_put_in(bench: TaskHarness) -> None:
    """An episode in which the cube was put into the chest, and has not rested there for long."""
    cube_pressed_on_the_floor(bench)
    bench.run_until(
        lambda arms: release(arms, INSERTER, opening=LET_GO),
        lambda: not bench.sim.contacts.gripper(INSERTER, "cube"),
    )
    assert bench.stage == 2


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.3), (0.1, 0.0, 0.0)])
def test_a_cube_that_moves_in_the_chest_does_not_count(
    bench: TaskHarness, velocity: tuple[float, float, float]
) -> None:
    cube_put_in(bench)
    resting = bench.sim.pose("cube")
    dof = bench.sim.model.joint("cube").dofadr[0]
    for _ in range(2 * REST_STEPS):
        bench.sim.place("cube", resting)
        bench.sim.data.qvel[dof : dof + 3] = velocity
        bench.sim.forward()
        assert bench.judge() == 2
        assert bench.sim.contacts.between("cube", "chest")
    bench.sim.place("cube", resting)
    bench.sim.forward()
    assert bench.hold(REST_STEPS + 5) == 3


def test_a_cube_in_the_air_of_the_chest_does_not_count(bench: TaskHarness) -> None:
    cube_put_in(bench)
    above = bench.sim.pose("cube").moved(z=0.010)
    for _ in range(2 * REST_STEPS):
        bench.put(cube=above)
    assert bench.stage == 2
    assert bench.hold(REST_STEPS + 10) == 3


def test_a_cube_that_was_never_held_over_an_open_chest_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bench.put(cube=in_chest(bench, 0.0, 0.0, ON_FLOOR))
    assert bench.hold(20) == 0
    set_lid(bench, LID_LIMITS[1])
    assert bench.judge() == 1
    assert bench.hold(30) == 1


def test_a_cube_that_came_after_the_lid_had_shut_does_not_count(bench: TaskHarness) -> None:
    lid_held_cube_aside(bench)
    bench.act(let_the_lid_go)
    bench.put(cube=in_chest(bench, 0.0, 0.0, ON_FLOOR))
    assert bench.hold(20) == 2


def test_a_cube_that_no_hand_put_into_the_chest_does_not_count(bench: TaskHarness) -> None:
    lid_held_cube_aside(bench)
    bench.put(cube=in_chest(bench, 0.0, 0.0, ON_FLOOR))
    assert bench.hold(2 * REST_STEPS) == 2


def test_a_lid_that_is_open_by_too_little_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    set_lid(bench, OPEN_ANGLE - 0.01)
    assert bench.judge() == 0
    set_lid(bench, OPEN_ANGLE + 0.01)
    assert bench.judge() == 1


# --- physics and objects -------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.1, 0.2, OPEN_ANGLE, 1.2, LID_LIMITS[1]])
def test_the_lid_falls_shut_within_a_second(bench: TaskHarness, angle: float) -> None:
    bench.start(0)
    set_lid(bench, angle)
    bench.hold(1)
    assert bench.sim.angle(LID) < angle
    bench.hold(28)
    assert bench.sim.angle(LID) < 0.01


def test_its_weight_alone_shuts_the_lid(bench: TaskHarness) -> None:
    bench.start(0)
    joint = bench.sim.model.joint(LID)
    assert joint.stiffness[0] == 0.0
    for angle in np.linspace(*LID_LIMITS, 5):
        set_lid(bench, float(angle))
        assert bench.sim.data.qfrc_passive[joint.dofadr[0]] == 0.0
        # In N·m: what is left of it at the stop is many times what a screw's friction takes.
        assert bench.sim.data.qfrc_bias[joint.dofadr[0]] > 0.04


def test_the_lid_goes_no_further_than_its_stop(bench: TaskHarness) -> None:
    bench.start(0)
    set_lid(bench, OPEN_ANGLE)
    bench.sim.data.qvel[bench.sim.model.joint(LID).dofadr[0]] = 20.0
    bench.sim.forward()
    highest = 0.0
    for _ in range(30):
        bench.hold(1)
        highest = max(highest, bench.sim.angle(LID))
    assert highest == pytest.approx(LID_LIMITS[1], abs=0.03)
    assert bench.sim.angle(LID) < 0.01


def test_the_lid_shuts_on_its_own_when_the_arm_draws_back(bench: TaskHarness) -> None:
    bench.start(0)
    bench.reach(script, 2)
    assert bench.sim.angle(LID) > OPEN_ANGLE
    bench.act(let_the_lid_go)
    assert bench.sim.angle(LID) < 0.01


def test_the_cavity_is_empty_and_as_large_as_the_task_says(bench: TaskHarness) -> None:
    bench.start(0)
    inset = HALF + 0.0005
    for x in (-0.065 + inset, 0.065 - inset):
        for y in (-0.115 + inset, 0.115 - inset):
            for z in (ON_FLOOR + 0.0005, RIM_HEIGHT - inset):
                bench.put(cube=in_chest(bench, x, y, z))
                assert bench.sim.contacts.partners("cube") == set()
    bench.put(cube=in_chest(bench, 0.065 - HALF + 0.001, 0.0, ON_FLOOR))
    assert bench.sim.contacts.between("cube", "chest")
