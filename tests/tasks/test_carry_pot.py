import math

import manifold3d
import numpy as np
import pytest

from duobench.experts.carry_pot import script
from duobench.experts.motion import Arms, Script, down, grip, move, wait
from duobench.solids.pot import HANDLE_OFFSET, HANDLE_Z, HEIGHT, MASS, PLATE, RADIUS
from duobench.solids.solid import manifold_of
from duobench.spatial import SE3
from duobench.tasks.carry_pot import HANDLES, OFF_CENTRE, TASK
from duobench.types import Side
from tests.stageplay import Stageplay

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
        tilt = math.radians(degrees)
        height = HEIGHT / 2 * math.cos(tilt) + RADIUS * math.sin(tilt)
        leaning = SE3.at(z=PLATE[2] + height) @ SE3.about((1, 0, 0), tilt)
        bench.put(pot=bench.sim.pose("stove") @ leaning)
        assert bench.sim.contacts.between("pot", "stove")
        assert bench.stage == stage


def _grasp(arms: Arms, side: Side, *, yaw: float, along: float, inward: float) -> SE3:
    """A grasp at a handle: `along` its bar and `inward` from it, in metres."""
    sign = 1.0 if side is Side.LEFT else -1.0
    pot = arms.sim.pose("pot")
    x, y, z = pot.apply((along, sign * (HANDLE_OFFSET - inward), HANDLE_Z + 0.004))
    return down(x, y, z, yaw=pot.yaw + yaw)


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize(
    ("yaw", "along", "inward"),
    [(0.0, 0.0, 0.0), (0.0, -0.025, 0.0), (math.pi / 2, 0.045, 0.016)],
    ids=["bar", "end of the bar", "stay"],
)
def test_one_gripper_cannot_carry_the_pot_level(
    bench: Stageplay, side: Side, yaw: float, along: float, inward: float
) -> None:
    def lift(arms: Arms) -> Script:
        grasp = _grasp(arms, side, yaw=yaw, along=along, inward=inward)
        arms.openings[side.index] = 0.45
        yield from move(arms, {side: grasp.moved(z=0.1)})
        yield from move(arms, {side: grasp}, speed=0.25)
        yield from grip(arms, side)
        yield from move(arms, {side: grasp.moved(z=0.1)}, speed=0.1)
        yield from wait(30)

    bench.start(0)
    assert bench.act(lift) == 1
    assert bench.sim.contacts.pads(side, f"pot/{side}_handle")
    assert bench.sim.pose("pot").rotation[2, 2] < math.cos(math.radians(15))
    assert bench.sim.contacts.between("pot", "table")


# --- objects -------------------------------------------------------------------------------------


def test_the_pot_weighs_what_the_task_says(bench: Stageplay) -> None:
    bodies = ("pot", *HANDLES)
    assert sum(bench.sim.model.body(name).mass[0] for name in bodies) == pytest.approx(MASS)


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
