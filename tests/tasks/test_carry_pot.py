import math

import manifold3d
import numpy as np
import pytest

from duobench.experts import carry_pot
from duobench.experts.carry_pot import script
from duobench.experts.motion import Arms, Script, carry, wait
from duobench.solids.pot import (
    BAR_RADIUS,
    HANDLE_OFFSET,
    HANDLE_Z,
    HEIGHT,
    HINGE_OFFSET,
    HINGE_Z,
    PLATE,
    RADIUS,
)
from duobench.solids.solid import manifold_of
from duobench.spatial import SE3
from duobench.tasks.carry_pot import HANDLES, LIFT, OFF_CENTRE, TASK
from duobench.types import SIDES, DuoCommand, Side
from tests.stageplay import Stageplay
from tests.tasks.test_one_gripper_on_the_pot import off_ground

ON_PLATE = PLATE[2] + HEIGHT / 2 + 0.0005
STEPS_TO_CARRY = 90
"""Control steps in which the expert has lifted the pot, and has not yet put it down."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


def carried(bench: Stageplay) -> None:
    """An episode in which both arms have carried the pot."""
    bench.start(0)
    assert bench.run_for(script, STEPS_TO_CARRY) == 2


def test_the_expert_passes_the_stages_in_order(bench: Stageplay) -> None:
    for seed in (3, 17):
        bench.start(seed)
        assert bench.run_for(script, TASK.horizon) == 3
        assert bench.history == sorted(bench.history)
        assert sorted(set(bench.history)) == [0, 1, 2, 3]
        assert bench.progress.final_holds


# --- what must not count -----------------------------------------------------------------------


def test_a_pot_on_the_plate_that_was_not_carried_does_not_count(bench: Stageplay) -> None:
    bench.start(0)
    bench.put(pot=bench.sim.pose("stove") @ SE3.at(z=ON_PLATE))
    assert bench.hold(20) == 0
    assert bench.sim.contacts.between("pot", "stove")


def test_a_pot_that_was_carried_counts_on_the_plate(bench: Stageplay) -> None:
    carried(bench)
    bench.put(pot=bench.sim.pose("stove") @ SE3.at(z=ON_PLATE))
    assert bench.hold(20) == 3


def test_a_pot_half_on_the_plate_and_half_on_the_table_does_not_count(bench: Stageplay) -> None:
    carried(bench)
    beside = SE3.at(y=-PLATE[1] / 2 - 0.02, z=PLATE[2] + HEIGHT / 2 + 0.001)
    bench.put(pot=bench.sim.pose("stove") @ beside)
    assert bench.hold(40) == 2
    assert bench.sim.contacts.between("pot", "stove")
    assert bench.sim.contacts.between("pot", "table")


def test_a_pot_far_from_the_middle_of_the_plate_does_not_count(bench: Stageplay) -> None:
    carried(bench)
    aside = SE3.at(x=OFF_CENTRE[0] + 0.01, z=ON_PLATE)
    bench.put(pot=bench.sim.pose("stove") @ aside)
    assert bench.hold(20) == 2
    assert not bench.sim.contacts.between("pot", "table")


def test_a_pot_above_the_plate_does_not_count(bench: Stageplay) -> None:
    carried(bench)
    bench.put(pot=bench.sim.pose("stove") @ SE3.at(z=ON_PLATE + 0.01))
    assert bench.stage == 2


def test_a_pot_leaning_on_the_plate_does_not_count(bench: Stageplay) -> None:
    carried(bench)
    for degrees, stage in ((12, 2), (8, 3)):
        angle = math.radians(degrees)
        height = HEIGHT / 2 * math.cos(angle) + RADIUS * math.sin(angle)
        leaning = SE3.at(z=PLATE[2] + height) @ SE3.about((0, 1, 0), angle)
        bench.put(pot=bench.sim.pose("stove") @ leaning)
        assert bench.sim.contacts.between("pot", "stove")
        assert bench.stage == stage


def on_table(bench: Stageplay) -> None:
    bench.put(pot=SE3.at(x=0.5, y=-0.1, z=HEIGHT / 2 - 0.0001))
    assert bench.sim.contacts.between("pot", "table")


def test_a_pot_that_was_put_back_and_pushed_onto_the_plate_does_not_count(
    bench: Stageplay,
) -> None:
    carried(bench)
    on_table(bench)
    bench.put(pot=bench.sim.pose("stove") @ SE3.at(z=ON_PLATE))
    assert bench.hold(20) == 2
    assert bench.sim.contacts.partners("pot") == {"stove"}


def test_a_pot_that_was_put_back_and_carried_again_counts(bench: Stageplay) -> None:
    carried(bench)
    held = bench.sim.save()
    on_table(bench)
    bench.sim.restore(held)
    bench.judge()
    bench.put(pot=bench.sim.pose("stove") @ SE3.at(z=ON_PLATE))
    assert bench.hold(20) == 3


def carried_but_not_judged(bench: Stageplay) -> None:
    """Both arms hold the pot in the air, in an episode that begins to be judged now."""
    bench.start(0)
    start = bench.sim.save()
    assert bench.run_for(script, STEPS_TO_CARRY) == 2
    now = bench.sim.save()
    bench.sim.restore(start)
    bench.progress.reset(bench.sim, {})
    bench.sim.restore(now)


def test_carrying_is_judged_from_one_state(bench: Stageplay) -> None:
    carried_but_not_judged(bench)
    assert bench.judge() == 2


@pytest.mark.parametrize("side", Side)
def test_a_pot_in_the_air_that_one_gripper_pinches_is_not_carried(
    bench: Stageplay, side: Side
) -> None:
    carried_but_not_judged(bench)
    command = bench.sim.duo.command()
    openings = command.openings.copy()
    openings[side.index] = 0.45
    while bench.sim.contacts.pads(side, f"pot/{side}_handle"):
        bench.sim.step(DuoCommand(joints=command.joints, openings=openings))
    assert bench.sim.contacts.pads(side.other, f"pot/{side.other}_handle")
    assert off_ground(bench)
    assert bench.sim.lowest("pot") > LIFT
    assert bench.judge() == 1


def test_a_pot_held_too_low_is_not_carried(bench: Stageplay) -> None:
    def lift(arms: Arms) -> Script:
        yield from carry_pot._grasp(arms)
        yield from carry(arms, "pot", arms.sim.pose("pot").moved(z=0.02), speed=0.1)
        yield from wait(10)

    bench.start(0)
    assert bench.act(lift) == 1
    assert off_ground(bench)
    assert 0.01 < bench.sim.lowest("pot") < LIFT


def pinched_by_both(bench: Stageplay) -> bool:
    return all(bench.sim.contacts.pads(side, f"pot/{side}_handle") for side in SIDES)


def test_a_pot_that_both_hold_on_the_plate_is_not_carried(bench: Stageplay) -> None:
    carried_but_not_judged(bench)
    state = bench.sim.save()
    # The plate comes to the pot: as high as the pot is, standing on it is all that is amiss.
    bottom = bench.sim.pose("pot") @ SE3.at(z=0.0002 - HEIGHT / 2 - PLATE[2])
    bench.put(stove=bottom)
    assert bench.sim.contacts.between("pot", "stove")
    assert pinched_by_both(bench)
    assert bench.stage == 1
    # The same with the bar of one handle on it.
    bench.sim.restore(state)
    beside = (0.0, HANDLE_OFFSET - 0.007 + PLATE[1] / 2, HANDLE_Z - BAR_RADIUS - PLATE[2])
    angle = bench.sim.angle(HANDLES[0])
    lower = (HANDLE_Z - HINGE_Z) * (1 - math.cos(angle)) + 0.0325 * math.sin(angle)
    bench.put(stove=bench.sim.pose("pot") @ SE3.at(*beside).moved(z=0.0002 - lower))
    assert bench.sim.contacts.between(HANDLES[0], "stove")
    assert not bench.sim.contacts.between("pot", "stove")
    assert pinched_by_both(bench)
    assert bench.stage == 1


def test_a_moving_pot_on_the_plate_does_not_count_yet(bench: Stageplay) -> None:
    carried(bench)
    start = bench.sim.model.joint("pot").dofadr[0]
    bench.sim.place("pot", bench.sim.pose("stove") @ SE3.at(z=ON_PLATE - 0.0006))
    for speed, stage in ((0.1, 2), (0.0, 3)):
        bench.sim.data.qvel[start] = speed
        bench.sim.refresh()
        assert bench.sim.contacts.between("pot", "stove")
        assert bench.judge() == stage


def test_a_pot_in_the_middle_of_the_plate_that_touches_the_table_does_not_count(
    bench: Stageplay,
) -> None:
    carried(bench)
    # As if the plate were let into the table.
    sunk = bench.sim.pose("stove").moved(z=-PLATE[2] - 0.0005)
    bench.put(stove=sunk, pot=sunk @ SE3.at(y=-0.07, z=ON_PLATE - 0.0006))
    assert bench.sim.contacts.between("pot", "stove")
    assert bench.sim.contacts.between("pot", "table")
    assert bench.stage == 2


def test_a_pot_on_the_plate_with_a_handle_on_the_table_does_not_count(bench: Stageplay) -> None:
    carried(bench)
    joint = bench.sim.model.joint(HANDLES[0])
    y, z = HANDLE_OFFSET - HINGE_OFFSET, HANDLE_Z - HINGE_Z
    drop = PLATE[2] + HEIGHT / 2 + HINGE_Z - BAR_RADIUS + 0.0005
    unfolded = math.pi / 2 + math.asin(drop / math.hypot(y, z)) - math.atan2(y, z)
    for angle, stage in ((unfolded, 2), (0.0, 3)):
        bench.sim.data.qpos[joint.qposadr[0]] = angle
        bench.put(pot=bench.sim.pose("stove") @ SE3.at(y=0.075, z=ON_PLATE - 0.0006))
        assert bench.sim.contacts.between(HANDLES[0], "table") == (stage == 2)
        assert not bench.sim.contacts.between("pot", "table")
        assert bench.stage == stage


# --- objects -------------------------------------------------------------------------------------


def test_the_pot_weighs_what_the_task_says(bench: Stageplay) -> None:
    bodies = ("pot", *HANDLES)
    assert sum(bench.sim.model.body(name).mass[0] for name in bodies) == pytest.approx(1.2)


def test_the_handles_are_one_piece_with_the_pot() -> None:
    prop = TASK.props[0]
    shapes = [manifold_of(shape) for shape in prop.solid.shapes]
    for part in prop.parts:
        pose = np.column_stack([part.pose.rotation, part.pose.translation])
        shapes += [manifold_of(shape).transform(pose) for shape in part.solid.shapes]
    whole = manifold3d.Manifold.batch_boolean(shapes, manifold3d.OpType.Add)
    assert len(whole.decompose()) == 1


def test_objects_rest_apart_at_reset(bench: Stageplay) -> None:
    for seed in range(10):
        layout = bench.start(seed)
        assert bench.sim.contacts.deepest(0.0005) == []
        assert bench.sim.contacts.partners("pot") == {"table"}
        moved, turned = bench.sim.pose("pot").distance(layout.poses["pot"])
        assert moved < 0.001
        assert turned < 0.01
        assert bench.hold(10) == 0
        assert np.max(bench.sim.speed("pot")) < 0.005


def test_the_pot_starts_in_the_right_half_and_the_plate_in_the_left(bench: Stageplay) -> None:
    for seed in range(10):
        poses = bench.start(seed).poses
        assert poses["pot"].translation[1] < 0 < poses["stove"].translation[1]
