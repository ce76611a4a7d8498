import math

import numpy as np
import pytest

from duobench.experts.motion import Arms, Script, move, release, wait
from duobench.experts.spring_door import script
from duobench.solids.blocks import CUBE_EDGE
from duobench.solids.microwave import (
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
from duobench.tasks.spring_door import OPEN_ANGLE, TASK
from duobench.types import Side
from tests.stageplay import Stageplay

DOOR = "microwave/door"
HALF = CUBE_EDGE / 2
ON_FLOOR = FLOOR + HALF
TOUCHING = ON_FLOOR - 0.0001
STEPS_TO_STAGE_2 = 165
"""Control steps in which the expert has the cube in the air and the door wide open."""
STEPS_TO_DROP = 199
"""Control steps in which the expert has the cube in the oven, still pinched."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


def in_oven(bench: Stageplay, x: float, y: float, z: float, yaw: float = 0.0) -> SE3:
    return bench.sim.pose("microwave") @ SE3.at(x, y, z, yaw=yaw)


def set_door(bench: Stageplay, angle: float) -> None:
    joint = bench.sim.model.joint(DOOR)
    bench.sim.data.qpos[joint.qposadr[0]] = angle
    bench.sim.data.qvel[joint.dofadr[0]] = 0.0
    bench.sim.refresh()


def let_the_door_go(arms: Arms) -> Script:
    yield from release(arms, Side.LEFT)
    back = arms.targets[Side.LEFT] @ SE3.at(z=-0.10)
    yield from move(arms, {Side.LEFT: back})
    yield from wait(90)


def door_held_open(bench: Stageplay) -> None:
    """An episode after stage 2: the left arm holds the door, the cube lies aside."""
    bench.start(0)
    assert bench.run_for(script, STEPS_TO_STAGE_2) == 2
    bench.act(lambda arms: release(arms, Side.RIGHT))
    bench.put(cube=SE3.at(0.3, -0.45, HALF))
    assert bench.hold(10) == 2
    assert bench.sim.angle(DOOR) > OPEN_ANGLE


def door_shut_again(bench: Stageplay) -> None:
    """An episode after stage 2: the door has shut, the cube lies aside."""
    door_held_open(bench)
    bench.act(let_the_door_go)
    assert bench.sim.angle(DOOR) < 0.02
    assert bench.stage == 2


@pytest.mark.parametrize("seed", [3, 17])
def test_the_expert_passes_the_stages_in_order(bench: Stageplay, seed: int) -> None:
    bench.start(seed)
    assert bench.run_for(script, TASK.horizon) == 3
    assert bench.history == sorted(bench.history)
    assert set(bench.history) == {0, 1, 2, 3}
    assert bench.progress.final_holds


# --- what must not count -------------------------------------------------------------------------


def test_a_cube_on_the_roof_does_not_count(bench: Stageplay) -> None:
    door_shut_again(bench)
    bench.put(cube=in_oven(bench, 0.0, CAVITY_CENTRE_Y, HEIGHT + HALF - 0.0001))
    assert bench.hold(10) == 2
    assert bench.sim.contacts.between("cube", "microwave")


def test_a_cube_behind_the_oven_does_not_count(bench: Stageplay) -> None:
    door_shut_again(bench)
    for height in (ON_FLOOR, HALF):
        bench.put(cube=in_oven(bench, DEPTH / 2 + HALF - 0.0001, CAVITY_CENTRE_Y, height))
        assert bench.sim.contacts.between("cube", "microwave")
        assert bench.stage == 2
    assert bench.hold(10) == 2


def test_a_cube_on_the_table_behind_the_door_does_not_count(bench: Stageplay) -> None:
    door_held_open(bench)
    bench.put(cube=in_oven(bench, FRONT - HALF - 0.03, CAVITY_CENTRE_Y, HALF))
    assert bench.hold(10) == 2
    assert bench.act(let_the_door_go) == 2
    assert bench.sim.contacts.between("cube", DOOR)
    assert bench.sim.angle(DOOR) > 0.05


def test_a_cube_wedged_in_the_door_does_not_count(bench: Stageplay) -> None:
    door_held_open(bench)
    bench.act(let_the_door_go)
    # A cube on its edge reaches over the front by 2 mm, and keeps the door from shutting.
    bench.put(cube=in_oven(bench, FRONT + 0.0206, CAVITY_CENTRE_Y, TOUCHING, math.pi / 4))
    assert bench.sim.contacts.between("cube", DOOR)
    assert bench.sim.contacts.between("cube", "microwave")
    assert bench.stage == 2


def test_a_cube_that_sticks_out_of_the_front_does_not_count(bench: Stageplay) -> None:
    door_held_open(bench)
    bench.put(cube=in_oven(bench, FRONT + HALF - 0.002, CAVITY_CENTRE_Y, TOUCHING))
    assert bench.hold(10) == 2
    assert bench.sim.contacts.between("cube", "microwave")


def test_a_cube_above_the_floor_or_at_the_wall_does_not_count(bench: Stageplay) -> None:
    door_held_open(bench)
    bench.put(cube=in_oven(bench, 0.0, CAVITY_CENTRE_Y, ON_FLOOR + 0.004))
    assert bench.stage == 2
    at_wall = CAVITY_CENTRE_Y + CAVITY[1] / 2 - HALF + 0.0001
    bench.put(cube=in_oven(bench, 0.0, at_wall, FLOOR + 0.12))
    assert bench.sim.contacts.between("cube", "microwave")
    assert bench.stage == 2


def test_a_cube_in_the_oven_counts_once_it_is_let_go(bench: Stageplay) -> None:
    bench.start(0)
    bench.run_for(script, STEPS_TO_DROP)

    def press(arms: Arms) -> Script:
        yield from move(arms, {Side.RIGHT: arms.targets[Side.RIGHT].moved(z=-0.012)})
        yield from wait(10)

    assert bench.act(press) == 2
    assert bench.sim.contacts.between("cube", "microwave")
    assert bench.sim.contacts.pads(Side.RIGHT, "cube")
    bench.act(lambda arms: release(arms, Side.RIGHT))
    assert bench.hold(10) == 3


def test_a_cube_that_was_never_held_at_an_open_door_does_not_count(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(cube=in_oven(bench, 0.0, CAVITY_CENTRE_Y, ON_FLOOR))
    assert bench.hold(10) == 0
    set_door(bench, 1.5)
    assert bench.judge() == 1
    assert bench.hold(10) == 1


def test_a_cube_that_was_held_at_the_open_door_counts_inside(bench: Stageplay) -> None:
    door_shut_again(bench)
    bench.put(cube=in_oven(bench, 0.0, CAVITY_CENTRE_Y, TOUCHING))
    assert bench.hold(5) == 3


def test_a_door_that_is_open_by_too_little_does_not_count(bench: Stageplay) -> None:
    bench.start(0)
    set_door(bench, OPEN_ANGLE - 0.01)
    assert bench.judge() == 0
    set_door(bench, OPEN_ANGLE + 0.01)
    assert bench.judge() == 1


# --- physics and objects -------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.3, OPEN_ANGLE, 1.5, DOOR_LIMITS[1]])
def test_the_door_shuts_within_two_seconds(bench: Stageplay, angle: float) -> None:
    bench.start(0)
    set_door(bench, angle)
    bench.hold(1)
    assert 0.5 * angle < bench.sim.angle(DOOR) < angle
    bench.hold(59)
    assert bench.sim.angle(DOOR) < 0.02


def test_one_arm_holds_the_door_open(bench: Stageplay) -> None:
    door_held_open(bench)
    angle = bench.sim.angle(DOOR)
    bench.hold(60)
    assert bench.sim.angle(DOOR) == pytest.approx(angle, abs=0.02)


def test_the_door_clears_the_oven_at_every_angle(bench: Stageplay) -> None:
    bench.start(0)
    for angle in np.linspace(*DOOR_LIMITS, 20):
        set_door(bench, float(angle))
        assert not bench.sim.contacts.between(DOOR, "microwave")


def test_there_is_room_for_fingers_behind_the_bar(
    bench: Stageplay,
) -> None:
    bench.start(0)
    behind = bench.sim.pose(DOOR) @ SE3.at(BAR[0] + 0.030, BAR[1], 0.0)
    for height in (-0.3 * BAR_LENGTH, 0.0, 0.3 * BAR_LENGTH):
        bench.put(cube=behind.moved(z=height))
        assert bench.sim.contacts.partners("cube") == set()


def test_the_cavity_is_empty_and_as_large_as_the_task_says(bench: Stageplay) -> None:
    bench.start(0)
    inset = HALF + 0.0005
    low_y, high_y = CAVITY_CENTRE_Y - 0.165, CAVITY_CENTRE_Y + 0.165
    for x in (FRONT + inset, FRONT + 0.26 - inset):
        for y in (low_y + inset, high_y - inset):
            for z in (0.03 + inset, 0.27 - inset):
                bench.put(cube=in_oven(bench, x, y, z))
                assert bench.sim.contacts.partners("cube") == set()


def test_the_door_weighs_what_it_should(bench: Stageplay) -> None:
    assert bench.sim.model.body(DOOR).mass[0] == pytest.approx(DOOR_MASS)


def test_objects_rest_apart_at_reset(bench: Stageplay) -> None:
    for seed in range(10):
        layout = bench.start(seed)
        assert bench.sim.contacts.deepest(0.0005) == []
        assert bench.sim.contacts.partners("cube") == {"table"}
        assert bench.sim.angle(DOOR) == pytest.approx(0.0, abs=0.002)
        moved, turned = bench.sim.pose("cube").distance(layout.poses["cube"])
        assert moved < 0.001
        assert turned < 0.01
        assert bench.hold(5) == 0
        assert np.max(bench.sim.speed("cube")) < 0.005
