import manifold3d
import numpy as np
import pytest

from duobench.experts.handover import clasp, let_go, pick_bar, present, receive_pose
from duobench.experts.motion import Arms, Script, move, wait
from duobench.experts.transfer_gate import (
    BAR,
    RECEIVER_GRIP,
    RISE,
    leave,
    lower_onto_mat,
    reach_through,
    ring,
    script,
)
from duobench.sim.layout import Layout
from duobench.solids.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.solids.gate import (
    MAT_EDGE,
    MAT_THICKNESS,
    RING_HEIGHT,
    RING_RADIUS,
    RING_THICKNESS,
    STAND_MASS,
    gate,
)
from duobench.solids.shapes import cylinder
from duobench.solids.solid import PLA_DENSITY, manifold_of
from duobench.spatial import SE3
from duobench.tasks.transfer_gate import CROSSING_RADIUS, TASK
from duobench.types import Side
from tests.handovers import bring, drop
from tests.stageplay import Stageplay

LEFT, RIGHT = Side.LEFT, Side.RIGHT
MAT = np.array([0.5, 0.22, MAT_THICKNESS / 2])
"""Where both arms reach the mat."""
HALF_MAT = MAT_EDGE / 2
LYING_HEIGHT = MAT_THICKNESS + CUBE_EDGE / 2
LAYOUT = Layout(
    poses={
        "block": SE3.at(0.5, -0.25, CUBE_EDGE / 2, yaw=0.3),
        "gate": SE3.at(0.4, 0.0),
        "mat": SE3.at(*MAT),
    }
)
AROUND = np.array([0.66, 0.03, 0.375])
"""On the left side, beyond the ring: where it can be handed over around the ring."""


@pytest.fixture(scope="module")
def bench() -> Stageplay:
    return Stageplay(TASK)


@pytest.fixture
def table(bench: Stageplay) -> Stageplay:
    bench.start(layout=LAYOUT)
    return bench


def take(arms: Arms) -> Script:
    """The left arm takes over where the right one presents the block."""
    yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))
    yield from let_go(arms, RIGHT)
    yield from leave(arms, RIGHT)


def hand_over(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms)
    yield from take(arms)


def let_fall(arms: Arms) -> Script:
    """The left arm takes over and drops the block onto the mat from a hand's breadth above."""
    yield from hand_over(arms)
    yield from bring(arms, LEFT, "block", (MAT[0], MAT[1], 0.12))
    yield from drop(arms, LEFT)


def pull_back(arms: Arms) -> Script:
    before = present(BAR, ring(arms) + np.array([0.0, -0.16, 0.0]), RISE)
    yield from move(arms, {RIGHT: before}, speed=0.3)


def go_around(arms: Arms) -> Script:
    for y in (-0.16, AROUND[1]):
        goal = present(BAR, np.array([AROUND[0], y, AROUND[2]]), RISE)
        yield from move(arms, {RIGHT: goal})


def slide_gate_over_block(bench: Stageplay) -> None:
    """Let the block cross the ring, in whatever hand, by moving the ring."""
    x, y, z = bench.sim.position("block")
    for beyond in (-0.02, 0.02):
        bench.put(gate=SE3.at(x, y - beyond, z - RING_HEIGHT))


def on_mat_in_hand(bench: Stageplay) -> bool:
    pinched = bench.sim.contacts.pads(LEFT, "block")
    return pinched and bench.sim.contacts.between("block", "mat")


def on_mat(bench: Stageplay) -> bool:
    """Whether the block ended up on the mat, so that a refused stage says something."""
    return bench.sim.contacts.partners("block") == {"mat"}


@pytest.mark.parametrize("seed", [3, 17])
def test_the_expert_passes_the_stages_in_order(bench: Stageplay, seed: int) -> None:
    bench.start(seed)
    assert bench.run_for(script, TASK.horizon) == 4
    assert bench.history == sorted(bench.history)
    assert set(bench.history) == {0, 1, 2, 3, 4}
    assert bench.progress.final_holds
    assert on_mat(bench)


# --- what must not count -------------------------------------------------------------------------


def test_a_block_on_the_mat_that_nobody_handed_over_does_not_count(table: Stageplay) -> None:
    table.put(block=SE3.at(MAT[0], MAT[1], LYING_HEIGHT))
    assert table.hold(20) == 0
    assert on_mat(table)


@pytest.mark.parametrize(
    ("offset", "stage"),
    [(0.0, 2), (CROSSING_RADIUS - 0.002, 2), (CROSSING_RADIUS + 0.002, 0), (0.2, 0)],
)
def test_the_plane_must_be_crossed_inside_the_ring(
    table: Stageplay, offset: float, stage: int
) -> None:
    for y in (-0.02, 0.02):
        table.put(block=SE3.at(0.4 + offset, y, RING_HEIGHT))
    assert table.stage == stage


def test_crossing_on_the_table_does_not_count(table: Stageplay) -> None:
    fallen = SE3.at(0.4, 0.0, RING_RADIUS) @ SE3.about((0, 1, 0), np.pi / 2)
    sunk = fallen @ SE3.at(z=-RING_HEIGHT)
    for y in (-0.02, 0.02):
        table.put(gate=sunk, block=SE3.at(0.4, y, CUBE_EDGE / 2))
        assert table.sim.contacts.between("block", "table")
    assert table.stage == 0


def test_handing_over_around_the_ring_does_not_count(table: Stageplay) -> None:
    def around(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from go_around(arms)
        yield from take(arms)
        yield from lower_onto_mat(arms, LEFT)
        yield from drop(arms, LEFT)

    assert table.act(around) == 1
    assert on_mat(table)


def test_handing_over_around_the_ring_after_a_crossing_does_not_count(table: Stageplay) -> None:
    def back_and_around(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from reach_through(arms)
        yield from pull_back(arms)
        yield from go_around(arms)
        yield from take(arms)
        yield from lower_onto_mat(arms, LEFT)
        yield from drop(arms, LEFT)

    assert table.act(back_and_around) == 2
    assert on_mat(table)


def test_the_arm_that_picked_it_up_may_not_put_it_down(table: Stageplay) -> None:
    def alone(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from reach_through(arms)
        yield from pull_back(arms)
        yield from go_around(arms)
        yield from bring(arms, RIGHT, "block", (MAT[0], MAT[1], LYING_HEIGHT + 0.02))
        yield from drop(arms, RIGHT)

    assert table.act(alone) == 2
    assert on_mat(table)


def test_a_block_that_falls_behind_the_ring_was_not_handed_over(table: Stageplay) -> None:
    def throw(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from reach_through(arms)
        yield from drop(arms, RIGHT)

    assert table.act(throw) == 2
    table.put(block=SE3.at(MAT[0], MAT[1], LYING_HEIGHT))
    assert table.hold(20) == 2


def test_a_block_released_before_it_rests_does_not_count(table: Stageplay) -> None:
    assert table.act(let_fall) == 3
    assert table.hold(20) == 3
    assert on_mat(table)


def test_touching_the_mat_once_before_a_fall_is_not_enough(table: Stageplay) -> None:
    def dip(arms: Arms) -> Script:
        yield from hand_over(arms)
        yield from lower_onto_mat(arms, LEFT)
        yield from move(arms, {LEFT: arms.targets[LEFT].moved(z=0.15)})
        yield from drop(arms, LEFT)

    assert table.act(dip) == 3
    assert table.hold(20) == 3
    assert on_mat(table)


def test_a_block_that_is_still_held_on_the_mat_does_not_count(table: Stageplay) -> None:
    def hold_on(arms: Arms) -> Script:
        yield from hand_over(arms)
        yield from lower_onto_mat(arms, LEFT)
        yield from wait(20)

    assert table.act(hold_on) == 3
    assert on_mat_in_hand(table)
    assert table.act(lambda arms: drop(arms, LEFT)) == 4


def test_taking_it_on_the_near_side_does_not_count(table: Stageplay) -> None:
    def on_the_near_side(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from go_around(arms)
        yield from take(arms)

    table.put(gate=SE3.at(0.2, 0.5))
    assert table.act(on_the_near_side) == 1
    slide_gate_over_block(table)
    assert table.stage == 2
    assert table.sim.contacts.pads(LEFT, "block")


def test_a_block_that_goes_back_before_it_is_taken_does_not_count(table: Stageplay) -> None:
    def both_hold(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from reach_through(arms)
        yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))

    assert table.act(both_hold) == 2
    table.put(gate=SE3.at(0.2, 0.5))
    assert table.act(lambda arms: let_go(arms, RIGHT)) == 2
    slide_gate_over_block(table)
    assert table.stage == 3


def test_a_block_that_was_handed_back_does_not_count(table: Stageplay) -> None:
    def lay_down(arms: Arms) -> Script:
        yield from bring(arms, RIGHT, "block", (MAT[0], MAT[1], LYING_HEIGHT))
        yield from drop(arms, RIGHT)

    table.act(lambda arms: pick_bar(arms, BAR))
    in_right_hand = table.sim.save()
    table.start(layout=LAYOUT)
    assert table.act(hand_over) == 3
    assert table.act(lambda arms: lower_onto_mat(arms, LEFT)) == 3
    table.sim.restore(in_right_hand)
    assert table.judge() == 3
    table.arms = Arms(table.sim)
    assert table.act(lay_down) == 3
    assert on_mat(table)


def test_having_touched_the_mat_before_the_handover_is_not_enough(table: Stageplay) -> None:
    table.act(hand_over)
    table.act(lambda arms: lower_onto_mat(arms, LEFT))
    left_on_mat = table.sim.save()
    table.start(layout=LAYOUT)
    fresh = table.sim.save()
    table.sim.restore(left_on_mat)
    table.judge()
    assert on_mat_in_hand(table)
    table.sim.restore(fresh)
    assert table.act(let_fall) == 3
    assert table.hold(20) == 3
    assert on_mat(table)


def test_only_a_block_that_rests_on_the_mat_counts(table: Stageplay) -> None:
    table.act(hand_over)
    assert table.act(lambda arms: lower_onto_mat(arms, LEFT)) == 3
    assert on_mat_in_hand(table)
    beside = SE3.at(MAT[0], MAT[1] + HALF_MAT + 0.002, LYING_HEIGHT - 0.0002)
    table.put(mat=SE3.at(*MAT), block=beside)
    assert on_mat(table)
    assert table.stage == 3
    inside = beside.moved(y=-0.004)
    table.put(block=inside.moved(z=0.003))
    assert table.stage == 3
    table.put(block=inside)
    assert on_mat(table)
    assert table.stage == 4


# --- objects -------------------------------------------------------------------------------------


def test_the_stand_is_heavy_and_the_block_is_not(bench: Stageplay) -> None:
    mass = {name: bench.sim.model.body(name).mass[0] for name in ("gate", "block")}
    assert mass["gate"] == pytest.approx(STAND_MASS)
    assert mass["block"] == pytest.approx(LONG_BLOCK * CUBE_EDGE**2 * PLA_DENSITY)


def test_the_ring_is_as_wide_as_the_task_says() -> None:
    axis = SE3.at(z=RING_HEIGHT) @ SE3.about((1, 0, 0), np.pi / 2)
    ring_on_stand = sum((manifold_of(shape) for shape in gate().shapes), manifold3d.Manifold())
    overlap = [
        (ring_on_stand ^ manifold_of(cylinder(radius, 0.1, at=axis))).volume()
        for radius in (RING_RADIUS, RING_RADIUS + RING_THICKNESS / 2)
    ]
    assert overlap[0] < 1e-12
    assert overlap[1] > 1e-6


@pytest.mark.parametrize("seed", range(10))
def test_objects_rest_apart_at_reset(bench: Stageplay, seed: int) -> None:
    layout = bench.start(seed)
    assert bench.sim.contacts.deepest(0.0005) == []
    for name in ("block", "gate"):
        assert bench.sim.contacts.partners(name) == {"table"}
        moved, turned = bench.sim.pose(name).distance(layout.poses[name])
        assert moved < 0.001
        assert turned < 0.01
        assert max(bench.sim.speed(name)) < 0.005
    assert bench.hold(10) == 0
    block, mat = bench.sim.position("block"), bench.sim.position("mat")
    assert block[1] < bench.sim.position("gate")[1] < mat[1]
