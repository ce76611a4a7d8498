import itertools

import mujoco
import numpy as np
import pytest

from duobench.experts.handling import LET_GO
from duobench.experts.motion import Arms, Script, move, release, together, wait
from duobench.experts.scripts.spring_door import INSERTER, fetch, open_door, reach_in
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.microwave import (
    CAVITY,
    CAVITY_CENTRE_Y,
    DEPTH,
    DOOR_LIMITS,
    FLOOR,
    FRONT,
    HEIGHT,
)
from duobench.spatial import SE3
from duobench.stages.placing import REST_SECONDS
from duobench.tasks.spring_door import OPEN_ANGLE
from duobench.types import CONTROL_HZ
from tests.sincere.spring_door import Putting, done, put_in
from tests.task_harness import TaskHarness, set_hinge

DOOR = "microwave/door"
HALF = CUBE_EDGE / 2
ON_FLOOR = FLOOR + HALF
TOUCHING = ON_FLOOR - 0.0001
REST_STEPS = round(REST_SECONDS * CONTROL_HZ) + 1


def in_oven(bench: TaskHarness, x: float, y: float, z: float, yaw: float = 0.0) -> SE3:
    return bench.sim.pose("microwave") @ SE3.at(x, y, z, yaw=yaw)


# --- where the cube must be; who brings it, and how, is in tests/stages/test_support.py ---------


def cube_let_go_inside(bench: TaskHarness) -> None:
    """An episode in which the cube has just been let go on the cavity's floor: all but rest."""

    def press(arms: Arms) -> Script:
        yield from together(open_door(arms), fetch(arms))
        yield from reach_in(arms)
        yield from move(arms, {INSERTER: arms.targets[INSERTER].moved(z=-0.012)})
        yield from wait(10)
        yield from release(arms, INSERTER, opening=LET_GO)

    contacts = bench.sim.contacts
    bench.start(0)
    bench.run_until(
        press,
        lambda: contacts.between("cube", "microwave") and not contacts.gripper(INSERTER, "cube"),
    )
    assert bench.stage == 2


def put_for_a_while(bench: TaskHarness, pose: SE3) -> None:
    """A cube that stays somewhere until it would count, while the door is held."""
    for _ in range(REST_STEPS):
        bench.put(cube=pose)
    assert bench.sim.angle(DOOR) > OPEN_ANGLE


def test_a_cube_that_is_let_go_high_above_the_floor_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    bench.act(lambda arms: put_in(arms, Putting(drop=0.12, slope=1.0)))
    bench.hold(30)
    assert done(bench.sim)
    assert bench.stage == 2


AT_WALL = CAVITY_CENTRE_Y + CAVITY[1] / 2 - HALF + 0.0001
BEHIND = DEPTH / 2 + HALF - 0.0001


@pytest.mark.parametrize(
    ("place", "touches", "stage"),
    [
        ((0.0, CAVITY_CENTRE_Y, TOUCHING), True, 3),
        ((0.0, CAVITY_CENTRE_Y, HEIGHT + HALF - 0.0001), True, 2),
        ((BEHIND, CAVITY_CENTRE_Y, ON_FLOOR), True, 2),
        ((BEHIND, CAVITY_CENTRE_Y, HALF), True, 2),
        ((FRONT + HALF - 0.002, CAVITY_CENTRE_Y, TOUCHING), True, 2),
        ((0.0, CAVITY_CENTRE_Y, ON_FLOOR + 0.004), False, 2),
        ((0.0, AT_WALL, FLOOR + 0.12), True, 2),
    ],
    ids=[
        "inside",
        "roof",
        "behind",
        "behind, low",
        "out of the front",
        "above the floor",
        "at the wall",
    ],
)
def test_only_a_cube_on_the_floor_of_the_oven_counts(
    bench: TaskHarness, place: tuple[float, float, float], touches: bool, stage: int
) -> None:
    cube_let_go_inside(bench)
    put_for_a_while(bench, in_oven(bench, *place))
    assert bench.sim.contacts.between("cube", "microwave") == touches
    assert bench.stage == stage


def test_a_cube_that_slides_over_the_floor_does_not_count(bench: TaskHarness) -> None:
    cube_let_go_inside(bench)
    for _ in range(REST_STEPS):
        bench.sim.place("cube", in_oven(bench, 0.0, CAVITY_CENTRE_Y, TOUCHING))
        bench.push("cube", 0.1)
        assert bench.judge() == 2
        assert bench.sim.contacts.between("cube", "microwave")


# --- physics and objects -------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.3, OPEN_ANGLE, 1.5, DOOR_LIMITS[1]])
def test_the_door_shuts_within_two_seconds(bench: TaskHarness, angle: float) -> None:
    bench.start(0)
    set_hinge(bench.sim, DOOR, angle)
    bench.hold(1)
    assert 0.5 * angle < bench.sim.angle(DOOR) < angle
    bench.hold(59)
    assert bench.sim.angle(DOOR) < 0.02


def test_the_door_clears_the_oven_at_every_angle(bench: TaskHarness) -> None:
    """The engine lets a body and the one that carries it overlap, so distances are asked for."""
    model, data = bench.sim.model, bench.sim.data
    bench.start(0)
    oven, door = (
        [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_contype[g]]
        for body in map(bench.sim.body_id, ("microwave", DOOR))
    )
    for angle in np.linspace(*DOOR_LIMITS, 20):
        set_hinge(bench.sim, DOOR, float(angle))
        for one, other in itertools.product(oven, door):
            assert mujoco.mj_geomDistance(model, data, one, other, 0.1, None) > 0.0


def test_the_cavity_is_empty_and_as_large_as_the_task_says(bench: TaskHarness) -> None:
    bench.start(0)
    inset = HALF + 0.0005
    low_y, high_y = CAVITY_CENTRE_Y - 0.165, CAVITY_CENTRE_Y + 0.165
    for x in (FRONT + inset, FRONT + 0.26 - inset):
        for y in (low_y + inset, high_y - inset):
            for z in (0.03 + inset, 0.27 - inset):
                bench.put(cube=in_oven(bench, x, y, z))
                assert bench.sim.contacts.partners("cube") == set()
