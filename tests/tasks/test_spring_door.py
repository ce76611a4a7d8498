import itertools
import math

import mujoco
import numpy as np
import pytest

from duobench.experts.handling import LET_GO
from duobench.experts.motion import Arms, Script, move, release, together, wait
from duobench.experts.scripts.spring_door import (
    HOLDER,
    INSERTER,
    fetch,
    open_door,
    reach_in,
    script,
)
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.microwave import (
    BAR,
    BAR_LENGTH,
    CAVITY,
    CAVITY_CENTRE_Y,
    DEPTH,
    DOOR_LIMITS,
    DOOR_MASS,
    FLOOR,
    FRONT,
    HEIGHT,
)
from duobench.spatial import SE3
from duobench.stages.placing import REST_SECONDS
from duobench.tasks.spring_door import OPEN_ANGLE, TASK
from duobench.types import CONTROL_HZ
from tests.sincere.spring_door import Putting, done, put_in
from tests.task_harness import TaskHarness

DOOR = "microwave/door"
HALF = CUBE_EDGE / 2
ON_FLOOR = FLOOR + HALF
TOUCHING = ON_FLOOR - 0.0001
REST_STEPS = round(REST_SECONDS * CONTROL_HZ) + 1


@pytest.fixture(scope="module")
def bench() -> TaskHarness:
    return TaskHarness(TASK)


def in_oven(bench: TaskHarness, x: float, y: float, z: float, yaw: float = 0.0) -> SE3:
    return bench.sim.pose("microwave") @ SE3.at(x, y, z, yaw=yaw)


def set_door(bench: TaskHarness, angle: float) -> None:
    joint = bench.sim.model.joint(DOOR)
    bench.sim.data.qpos[joint.qposadr[0]] = angle
    bench.sim.data.qvel[joint.dofadr[0]] = 0.0
    bench.sim.forward()


def let_the_door_go(arms: Arms) -> Script:
    yield from release(arms, HOLDER)
    yield from move(arms, {HOLDER: arms.targets[HOLDER] @ SE3.at(z=-0.10)})
    yield from wait(90)


def door_held_open(bench: TaskHarness) -> None:
    """An episode after stage 2: the left arm holds the door, the cube lies aside."""
    bench.start(0)
    bench.reach(script, 2)
    bench.act(lambda arms: release(arms, INSERTER))
    bench.put(cube=SE3.at(0.3, -0.45, HALF))
    assert bench.hold(10) == 2
    assert bench.sim.angle(DOOR) > OPEN_ANGLE


def door_shut_again(bench: TaskHarness) -> None:
    """An episode after stage 2: the door has shut, the cube lies aside."""
    door_held_open(bench)
    bench.act(let_the_door_go)
    assert bench.sim.angle(DOOR) < 0.02
    assert bench.stage == 2


def cube_pressed_on_the_floor(bench: TaskHarness) -> None:
    """An episode in which the right arm has the cube on the cavity's floor, still pinched."""

    def press(arms: Arms) -> Script:
        yield from together(open_door(arms), fetch(arms))
        yield from reach_in(arms)
        yield from move(arms, {INSERTER: arms.targets[INSERTER].moved(z=-0.012)})
        yield from wait(10)

    bench.start(0)
    bench.act(press)
    assert bench.sim.contacts.between("cube", "microwave")
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
    assert bench.run_for(script, TASK.horizon) == 3
    bench.hold(30)
    assert bench.progress.final_holds


# --- what must not count -------------------------------------------------------------------------


def cube_let_go_inside(bench: TaskHarness) -> None:
    """An episode in which the cube has just been let go on the cavity's floor: all but rest."""
    cube_pressed_on_the_floor(bench)

    def let_go(arms: Arms) -> Script:
        yield from release(arms, INSERTER, opening=LET_GO)

    bench.run_until(let_go, lambda: not bench.sim.contacts.gripper(INSERTER, "cube"))
    assert bench.stage == 2


def put_for_a_while(bench: TaskHarness, pose: SE3) -> None:
    """A cube that stays somewhere until it would count, while the door is held."""
    for _ in range(REST_STEPS):
        bench.put(cube=pose)
    assert bench.sim.angle(DOOR) > OPEN_ANGLE


def test_a_cube_elsewhere_on_the_floor_counts(bench: TaskHarness) -> None:
    """It was let go inside, so the other tests differ in nothing but where it is."""
    cube_let_go_inside(bench)
    put_for_a_while(bench, in_oven(bench, 0.0, CAVITY_CENTRE_Y, TOUCHING))
    assert bench.stage == 3


@pytest.mark.parametrize(("drop", "stage"), [(0.025, 3), (0.055, 2)])
def test_a_cube_is_let_go_near_the_floor(bench: TaskHarness, drop: float, stage: int) -> None:
    bench.start(0)
    bench.act(lambda arms: put_in(arms, Putting(drop=drop, slope=1.0)))
    bench.hold(30)
    assert done(bench.sim)
    assert bench.stage == stage


def test_a_cube_on_the_roof_does_not_count(bench: TaskHarness) -> None:
    cube_let_go_inside(bench)
    put_for_a_while(bench, in_oven(bench, 0.0, CAVITY_CENTRE_Y, HEIGHT + HALF - 0.0001))
    assert bench.sim.contacts.between("cube", "microwave")
    assert bench.hold(REST_STEPS) == 2


def test_a_cube_behind_the_oven_does_not_count(bench: TaskHarness) -> None:
    cube_let_go_inside(bench)
    for height in (ON_FLOOR, HALF):
        behind = in_oven(bench, DEPTH / 2 + HALF - 0.0001, CAVITY_CENTRE_Y, height)
        put_for_a_while(bench, behind)
        assert bench.sim.contacts.between("cube", "microwave")
        assert bench.stage == 2
    assert bench.hold(REST_STEPS) == 2


def test_a_cube_on_the_table_behind_the_door_does_not_count(bench: TaskHarness) -> None:
    door_held_open(bench)
    bench.put(cube=in_oven(bench, FRONT - HALF - 0.03, CAVITY_CENTRE_Y, HALF))
    assert bench.hold(REST_STEPS) == 2
    assert bench.act(let_the_door_go) == 2
    assert bench.sim.contacts.between("cube", DOOR)
    assert bench.sim.angle(DOOR) > 0.05


def test_a_cube_wedged_in_the_door_does_not_count(bench: TaskHarness) -> None:
    cube_let_go_inside(bench)
    # A cube on its edge reaches over the front by 2 mm, and keeps the door from shutting.
    across = in_oven(bench, FRONT + 0.0206, CAVITY_CENTRE_Y, TOUCHING, math.pi / 4)
    for _ in range(REST_STEPS):
        set_door(bench, 0.0)
        bench.put(cube=across)
        assert bench.sim.contacts.between("cube", DOOR)
        assert bench.sim.contacts.between("cube", "microwave")
        assert bench.stage == 2
    set_door(bench, 0.2)
    for _ in range(REST_STEPS):
        bench.judge()
    assert bench.stage == 3


def test_a_cube_that_sticks_out_of_the_front_does_not_count(bench: TaskHarness) -> None:
    cube_let_go_inside(bench)
    bench.put(cube=in_oven(bench, FRONT + HALF - 0.002, CAVITY_CENTRE_Y, TOUCHING))
    assert bench.hold(REST_STEPS) == 2
    assert bench.sim.contacts.between("cube", "microwave")


def test_a_cube_above_the_floor_or_at_the_wall_does_not_count(bench: TaskHarness) -> None:
    cube_let_go_inside(bench)
    put_for_a_while(bench, in_oven(bench, 0.0, CAVITY_CENTRE_Y, ON_FLOOR + 0.004))
    assert bench.stage == 2
    at_wall = CAVITY_CENTRE_Y + CAVITY[1] / 2 - HALF + 0.0001
    put_for_a_while(bench, in_oven(bench, 0.0, at_wall, FLOOR + 0.12))
    assert bench.sim.contacts.between("cube", "microwave")
    assert bench.stage == 2


def test_a_cube_that_slides_over_the_floor_does_not_count(bench: TaskHarness) -> None:
    cube_let_go_inside(bench)
    dof = bench.sim.model.joint("cube").dofadr[0]
    for _ in range(REST_STEPS):
        bench.sim.place("cube", in_oven(bench, 0.0, CAVITY_CENTRE_Y, TOUCHING))
        bench.sim.data.qvel[dof] = 0.1
        bench.sim.forward()
        assert bench.judge() == 2
        assert bench.sim.contacts.between("cube", "microwave")


def test_a_cube_in_the_oven_counts_once_it_is_let_go(bench: TaskHarness) -> None:
    cube_pressed_on_the_floor(bench)
    assert bench.stage == 2
    bench.act(lambda arms: release(arms, INSERTER, opening=LET_GO))
    assert bench.hold(REST_STEPS) == 3


def test_a_cube_on_its_way_out_does_not_count(bench: TaskHarness) -> None:
    cube_pressed_on_the_floor(bench)
    bench.act(lambda arms: move(arms, {INSERTER: arms.targets[INSERTER] @ SE3.at(z=-0.2)}))
    assert bench.hold(REST_STEPS) == 2


def test_a_cube_that_was_never_held_at_an_open_door_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bench.put(cube=in_oven(bench, 0.0, CAVITY_CENTRE_Y, ON_FLOOR))
    assert bench.hold(REST_STEPS) == 0
    set_door(bench, 1.5)
    assert bench.judge() == 1
    assert bench.hold(REST_STEPS) == 1


def test_a_cube_that_came_after_the_door_had_shut_does_not_count(bench: TaskHarness) -> None:
    door_shut_again(bench)
    bench.put(cube=in_oven(bench, 0.0, CAVITY_CENTRE_Y, TOUCHING))
    assert bench.hold(REST_STEPS) == 2


def test_a_cube_that_no_hand_brought_does_not_count(bench: TaskHarness) -> None:
    door_held_open(bench)
    bench.put(cube=in_oven(bench, 0.0, CAVITY_CENTRE_Y, TOUCHING))
    assert bench.hold(2 * REST_STEPS) == 2


def test_a_door_that_is_open_by_too_little_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    set_door(bench, OPEN_ANGLE - 0.01)
    assert bench.judge() == 0
    set_door(bench, OPEN_ANGLE + 0.01)
    assert bench.judge() == 1


# --- physics and objects -------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.3, OPEN_ANGLE, 1.5, DOOR_LIMITS[1]])
def test_the_door_shuts_within_two_seconds(bench: TaskHarness, angle: float) -> None:
    bench.start(0)
    set_door(bench, angle)
    bench.hold(1)
    assert 0.5 * angle < bench.sim.angle(DOOR) < angle
    bench.hold(59)
    assert bench.sim.angle(DOOR) < 0.02


def test_one_arm_holds_the_door_open(bench: TaskHarness) -> None:
    door_held_open(bench)
    angle = bench.sim.angle(DOOR)
    bench.hold(60)
    assert bench.sim.angle(DOOR) == pytest.approx(angle, abs=0.02)


def test_the_door_clears_the_oven_at_every_angle(bench: TaskHarness) -> None:
    """The engine lets a body and the one that carries it overlap, so distances are asked for."""
    model, data = bench.sim.model, bench.sim.data
    bench.start(0)
    oven, door = (
        [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_contype[g]]
        for body in map(bench.sim.body_id, ("microwave", DOOR))
    )
    for angle in np.linspace(*DOOR_LIMITS, 20):
        set_door(bench, float(angle))
        for one, other in itertools.product(oven, door):
            assert mujoco.mj_geomDistance(model, data, one, other, 0.1, None) > 0.0


def test_there_is_room_for_fingers_behind_the_bar(
    bench: TaskHarness,
) -> None:
    bench.start(0)
    behind = bench.sim.pose(DOOR) @ SE3.at(BAR[0] + 0.030, BAR[1], 0.0)
    for height in (-0.3 * BAR_LENGTH, 0.0, 0.3 * BAR_LENGTH):
        bench.put(cube=behind.moved(z=height))
        assert bench.sim.contacts.partners("cube") == set()


def test_the_cavity_is_empty_and_as_large_as_the_task_says(bench: TaskHarness) -> None:
    bench.start(0)
    inset = HALF + 0.0005
    low_y, high_y = CAVITY_CENTRE_Y - 0.165, CAVITY_CENTRE_Y + 0.165
    for x in (FRONT + inset, FRONT + 0.26 - inset):
        for y in (low_y + inset, high_y - inset):
            for z in (0.03 + inset, 0.27 - inset):
                bench.put(cube=in_oven(bench, x, y, z))
                assert bench.sim.contacts.partners("cube") == set()


def test_the_door_weighs_what_it_should(bench: TaskHarness) -> None:
    assert bench.sim.model.body(DOOR).mass[0] == pytest.approx(DOOR_MASS)
