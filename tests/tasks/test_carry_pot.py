import math

import manifold3d
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.tasks.carry_pot import HANDLES, OFF_CENTRE, TASK
from duobench.tasks.experts.motion import Arms, Script
from duobench.tasks.experts.scripts.carry_pot import carry_over, land, let_go, lift, script
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.world.objects.pot import (
    ARM,
    BAR_LENGTH,
    BAR_RADIUS,
    HANDLE_OFFSET,
    HANDLE_Z,
    HEIGHT,
    PLATE,
    RADIUS,
)
from duobench.world.objects.solid import manifold_of
from duobench.world.scene.naming import TABLE
from tests.steps import do, pause
from tests.task_harness import TaskHarness

ON_PLATE = PLATE[2] + HEIGHT / 2 + 0.0005
REST_STEPS = round(REST_SECONDS * CONTROL_HZ)


def bring(arms: Arms, x: float = 0.0, y: float = 0.0, height: float = 0.04) -> Script:
    """Both arms carry the pot above the plate, beside the middle by x and y of the plate."""
    yield from lift(arms)
    goal_x, goal_y, _ = arms.sim.pose("stove").apply([x, y, 0.0])
    yield from carry_over(arms, goal_x, goal_y, height=height)


PUT_TOO_FAR = do((bring, OFF_CENTRE[0] + 0.01), land, let_go)


def put(bench: TaskHarness, x: float = 0.0, y: float = 0.0) -> int:
    """The stage after both arms put the pot onto the plate, beside the middle by x and y."""

    bench.start(0)
    return bench.act(do((bring, x, y), land, let_go))


def put_aside(bench: TaskHarness) -> None:
    """Both arms put the pot onto the plate, and all that is amiss is how far from the middle."""
    bench.start(0)
    assert bench.act(PUT_TOO_FAR) == 2
    assert bench.sim.contacts.partners("pot") == {"stove"}


def test_the_stove_may_be_turned(bench: TaskHarness) -> None:
    layout = bench.start(0)
    for turn in (-math.pi / 2, math.pi / 2):
        turned = layout.poses["stove"] @ SE3.at(yaw=turn)
        bench.start(layout=type(layout)(poses={**layout.poses, "stove": turned}))
        assert bench.run_for(script, TASK.horizon) == 3


@pytest.mark.parametrize("share", [0.9, 1.1])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_pot_counts_near_the_middle_of_the_plate(
    bench: TaskHarness, axis: int, share: float
) -> None:
    aside = [0.0, 0.0]
    aside[axis] = share * OFF_CENTRE[axis]
    assert put(bench, *aside) == (3 if share < 1 else 2)


def test_a_pot_that_is_still_in_hand_does_not_count(bench: TaskHarness) -> None:
    bench.start(0)
    assert bench.act(do(bring, land, (pause, 30))) == 2
    # Nor does one that one of them holds on to.
    assert bench.act(lambda arms: let_go(arms, Side.RIGHT)) == 2
    assert bench.act(lambda arms: let_go(arms, Side.LEFT)) == 3


def test_a_pot_half_on_the_plate_and_half_on_the_table_does_not_count(bench: TaskHarness) -> None:
    put_aside(bench)
    beside = SE3.at(y=-PLATE[1] / 2 - 0.02, z=PLATE[2] + HEIGHT / 2 + 0.001)
    bench.put(pot=bench.sim.pose("stove") @ beside)
    assert bench.hold(40) == 2
    assert bench.sim.contacts.between("pot", "stove")
    assert bench.sim.contacts.between("pot", TABLE)
    # Nor does it when it is pushed up from there.
    bench.put(pot=bench.sim.pose("stove") @ SE3.at(z=ON_PLATE))
    assert bench.hold(20) == 2


def test_a_pot_above_the_plate_does_not_count(bench: TaskHarness) -> None:
    put_aside(bench)
    for _ in range(2 * REST_STEPS):
        bench.put(pot=bench.sim.pose("stove") @ SE3.at(z=ON_PLATE + 0.003))
    assert bench.stage == 2
    assert bench.hold(REST_STEPS + 5) == 3


def test_a_pot_leaning_on_the_plate_does_not_count(bench: TaskHarness) -> None:
    put_aside(bench)
    for degrees, stage in ((12, 2), (8, 3)):
        angle = math.radians(degrees)
        height = HEIGHT / 2 * math.cos(angle) + RADIUS * math.sin(angle)
        leaning = SE3.at(z=PLATE[2] + height) @ SE3.about((0, 1, 0), angle)
        for _ in range(REST_STEPS):
            bench.put(pot=bench.sim.pose("stove") @ leaning)
            assert bench.sim.contacts.between("pot", "stove")
        assert bench.stage == stage


def test_a_moving_pot_on_the_plate_does_not_count_yet(bench: TaskHarness) -> None:
    put_aside(bench)
    bench.sim.place("pot", bench.sim.pose("stove") @ SE3.at(z=ON_PLATE - 0.0006))
    for speed, stage in ((0.1, 2), (0.0, 3)):
        bench.push("pot", speed)
        assert bench.sim.contacts.between("pot", "stove")
        assert bench.rest(REST_STEPS) == stage


def test_a_pot_in_the_middle_of_the_plate_that_touches_the_table_does_not_count(
    bench: TaskHarness,
) -> None:
    put_aside(bench)
    # As if the plate were let into the table.
    sunk = bench.sim.pose("stove").moved(z=-PLATE[2] - 0.0005)
    for _ in range(2 * REST_STEPS):
        bench.put(stove=sunk, pot=sunk @ SE3.at(y=-0.07, z=ON_PLATE - 0.0006))
    assert bench.sim.contacts.between("pot", "stove")
    assert bench.sim.contacts.between("pot", TABLE)
    assert bench.stage == 2


def carried_but_not_judged(bench: TaskHarness) -> None:
    """Both arms hold the pot in the air, in an episode that begins to be judged now."""
    bench.start(0)
    start = bench.sim.get_state()
    assert bench.act(lift) == 2
    now = bench.sim.get_state()
    bench.sim.set_state(start)
    bench.progress.reset(bench.sim, {})
    bench.sim.set_state(now)


def grasped_by_both(bench: TaskHarness) -> bool:
    return all(bench.sim.contacts.grasped(side, f"pot/{side}_handle") for side in SIDES)


def test_a_pot_that_both_hold_on_the_plate_is_not_carried(bench: TaskHarness) -> None:
    carried_but_not_judged(bench)
    state = bench.sim.get_state()
    # The plate comes to the pot: as high as the pot is, standing on it is all that is amiss.
    bottom = bench.sim.pose("pot") @ SE3.at(z=0.0002 - HEIGHT / 2 - PLATE[2])
    bench.put(stove=bottom)
    assert bench.sim.contacts.between("pot", "stove")
    assert grasped_by_both(bench)
    assert bench.stage == 1
    # The same with the bar of one handle on it.
    bench.sim.set_state(state)
    beside = (0.0, HANDLE_OFFSET - 0.004 + PLATE[1] / 2, HANDLE_Z - BAR_RADIUS - PLATE[2])
    bench.put(stove=bench.sim.pose("pot") @ SE3.at(*beside).moved(z=0.0002))
    assert bench.sim.contacts.between(HANDLES[0], "stove")
    assert not bench.sim.contacts.between("pot", "stove")
    assert grasped_by_both(bench)
    assert bench.stage == 1


def test_either_arm_may_hold_either_handle(bench: TaskHarness) -> None:
    carried_but_not_judged(bench)
    # Half a turn of the pot changes the hands at its handles, and is as good: one state shows it.
    bench.put(pot=bench.sim.pose("pot") @ SE3.at(yaw=math.pi))
    assert bench.stage == 2


def test_the_handles_are_one_rigid_piece_with_the_pot(bench: TaskHarness) -> None:
    prop = TASK.props[0]
    shapes = [manifold_of(shape) for shape in prop.solid.shapes]
    for part in prop.parts:
        pose = np.column_stack([part.pose.rotation, part.pose.translation])
        shapes += [manifold_of(shape).transform(pose) for shape in part.solid.shapes]
    whole = manifold3d.Manifold.batch_boolean(shapes, manifold3d.OpType.Add)
    assert len(whole.decompose()) == 1
    for handle in HANDLES:
        assert bench.sim.model.body(handle).jntnum[0] == 0


def test_a_handle_lies_within_the_wall_and_leaves_room_for_a_finger() -> None:
    prop = TASK.props[0]
    wall = manifold_of(prop.solid.shapes[0])
    for part in prop.parts:
        pose = np.column_stack([part.pose.rotation, part.pose.translation])
        bar, *arms = (manifold_of(shape).transform(pose) for shape in part.solid.shapes)
        assert bar.min_gap(wall, 0.1) == pytest.approx(
            HANDLE_OFFSET - BAR_RADIUS - RADIUS, abs=1e-4
        )
        for arm in arms:
            assert (arm ^ wall).volume() > ARM**2 * 0.002
    assert HANDLE_OFFSET - BAR_RADIUS - RADIUS > 0.025
    assert BAR_LENGTH > 0.06
