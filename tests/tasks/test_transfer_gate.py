import manifold3d
import numpy as np
import pytest

from duobench.experts.handover import clasp, let_go, pick_bar, present, receive_pose
from duobench.experts.motion import Arms, Script, down, grip, move, wait
from duobench.experts.scripts.transfer_gate import (
    BAR,
    RECEIVER_GRIP,
    RISE,
    lower_onto_mat,
    reach_through,
    script,
)
from duobench.objects.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.objects.gate import (
    BASE,
    MAT_EDGE,
    MAT_THICKNESS,
    RING_HEIGHT,
    RING_RADIUS,
    RING_THICKNESS,
    gate,
)
from duobench.objects.shapes import cylinder
from duobench.objects.solid import PLA_DENSITY, manifold_of
from duobench.sim import placement
from duobench.sim.layout import Layout
from duobench.spatial import SE3
from duobench.tasks.transfer_gate import CROSSING_RADIUS, TASK
from duobench.types import Side
from tests.adversaries.transfer_gate import hand_over, let_fall, onto_mat, take
from tests.handovers import bring, drop, lower, pick_lying
from tests.task_harness import TaskHarness

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
GATE_AWAY = SE3.at(0.2, 0.5)
"""So far on the left that everything happens on its near side."""


@pytest.fixture(scope="module")
def bench() -> TaskHarness:
    return TaskHarness(TASK)


@pytest.fixture
def table(bench: TaskHarness) -> TaskHarness:
    bench.start(layout=LAYOUT)
    return bench


def slide_gate_over_block(bench: TaskHarness, *, aside: float = 0.0) -> None:
    """Let the block cross the ring, in whatever hand, by moving the ring."""
    x, y, z = bench.sim.position("block")
    for beyond in (-0.02, 0.02):
        bench.put(gate=SE3.at(x - aside, y - beyond, z - RING_HEIGHT))


def on_mat(bench: TaskHarness) -> bool:
    """Whether the block ended up on the mat, so that a refused stage says something."""
    return bench.sim.contacts.partners("block") == {"mat"}


def on_mat_in_hand(bench: TaskHarness) -> bool:
    contacts = bench.sim.contacts
    return contacts.grasped(LEFT, "block") and contacts.between("block", "mat")


def both_hold(arms: Arms) -> Script:
    yield from pick_bar(arms, BAR)
    yield from reach_through(arms)
    yield from clasp(arms, LEFT, receive_pose(arms, BAR, RECEIVER_GRIP, 0.0))


@pytest.mark.parametrize("seed", [3, 17])
def test_the_expert_passes_the_stages_in_order(bench: TaskHarness, seed: int) -> None:
    bench.start(seed)
    assert bench.run_for(script, TASK.horizon) == 4
    assert bench.history == sorted(bench.history)
    assert set(bench.history) == {0, 1, 2, 3, 4}
    assert bench.progress.final_holds
    assert on_mat(bench)


# --- what must not count; what two arms can do of it is in tests/adversaries ---------------------


def test_a_block_on_the_mat_that_nobody_handed_over_does_not_count(table: TaskHarness) -> None:
    table.put(block=SE3.at(MAT[0], MAT[1], LYING_HEIGHT))
    assert table.hold(20) == 0
    assert on_mat(table)


@pytest.mark.parametrize(
    ("aside", "stage"),
    [(0.0, 2), (CROSSING_RADIUS - 0.002, 2), (CROSSING_RADIUS + 0.002, 1), (0.2, 1)],
)
def test_the_plane_must_be_crossed_inside_the_ring(
    table: TaskHarness, aside: float, stage: int
) -> None:
    assert table.act(lambda arms: pick_bar(arms, BAR)) == 1
    slide_gate_over_block(table, aside=aside)
    assert table.stage == stage


def test_crossing_on_the_table_does_not_count(table: TaskHarness) -> None:
    def grasp(arms: Arms) -> Script:
        x, y, z = arms.sim.position("block")
        yield from move(arms, {RIGHT: down(x, y, z + 0.1, yaw=0.3)})
        yield from move(arms, {RIGHT: down(x, y, z + 0.012, yaw=0.3)})
        yield from grip(arms, RIGHT)

    table.act(grasp)
    assert table.sim.contacts.grasped(RIGHT, "block")
    assert table.sim.contacts.between("block", "table")
    slide_gate_over_block(table)
    assert table.stage == 0


def test_flying_through_the_ring_does_not_count(table: TaskHarness) -> None:
    for y in (-0.03, -0.01, 0.01, 0.03):
        table.put(block=SE3.at(0.4, y, RING_HEIGHT))
    assert table.stage == 0


def test_taking_it_on_the_near_side_does_not_count(table: TaskHarness) -> None:
    def on_the_near_side(arms: Arms) -> Script:
        yield from pick_bar(arms, BAR)
        yield from move(arms, {RIGHT: present(BAR, (0.55, 0.03, RING_HEIGHT), RISE)})
        yield from take(arms)

    table.put(gate=GATE_AWAY)
    table.act(on_the_near_side)
    assert table.stage == 1
    slide_gate_over_block(table)
    assert table.stage == 2
    assert table.sim.contacts.grasped(LEFT, "block")
    assert table.act(lambda arms: lower_onto_mat(arms, LEFT)) == 2
    table.act(lambda arms: drop(arms, LEFT))
    assert table.stage == 2
    assert on_mat(table)


def test_a_block_that_goes_back_before_it_is_taken_does_not_count(table: TaskHarness) -> None:
    assert table.act(both_hold) == 2
    table.put(gate=GATE_AWAY)
    assert table.act(lambda arms: let_go(arms, RIGHT)) == 2
    slide_gate_over_block(table)
    assert table.stage == 2


def test_the_other_arm_has_it_alone_only_when_the_first_one_is_gone(table: TaskHarness) -> None:
    assert table.act(both_hold) == 2
    assert table.hold(15) == 2
    assert table.act(lambda arms: let_go(arms, RIGHT)) == 3


def test_a_block_that_was_handed_back_does_not_count(table: TaskHarness) -> None:
    table.act(lambda arms: pick_bar(arms, BAR))
    in_right_hand = table.sim.get_state()
    table.start(layout=LAYOUT)
    assert table.act(hand_over) == 3
    assert table.act(lambda arms: lower_onto_mat(arms, LEFT)) == 3
    table.sim.set_state(in_right_hand)
    table.put(gate=GATE_AWAY)
    table.arms = Arms(table.sim)
    assert table.act(lambda arms: onto_mat(arms, RIGHT)) == 3
    assert on_mat(table)


def test_a_block_that_is_still_held_on_the_mat_does_not_count(table: TaskHarness) -> None:
    def hold_on(arms: Arms) -> Script:
        yield from hand_over(arms)
        yield from lower_onto_mat(arms, LEFT)
        yield from wait(20)

    assert table.act(hold_on) == 3
    assert on_mat_in_hand(table)
    table.act(lambda arms: drop(arms, LEFT))
    assert table.hold(20) == 4


@pytest.mark.parametrize(("height", "stage"), [(0.008, 4), (0.020, 3)])
def test_a_block_is_put_down_from_a_few_millimetres(
    table: TaskHarness, height: float, stage: int
) -> None:
    def let_go_above(arms: Arms) -> Script:
        yield from hand_over(arms)
        yield from bring(arms, LEFT, "block", MAT + np.array([0.0, 0.0, 0.15]))
        yield from lower(arms, LEFT, "block", MAT_THICKNESS + height)
        assert not arms.sim.contacts.between("block", "mat")
        yield from drop(arms, LEFT)

    table.act(let_go_above)
    assert table.hold(20) == stage
    assert on_mat(table)


def test_a_block_that_was_let_go_on_the_far_side_must_come_through_again(
    table: TaskHarness,
) -> None:
    assert table.act(both_hold) == 2
    both = table.sim.get_state()
    assert table.act(lambda arms: let_go(arms, RIGHT)) == 3
    left = table.sim.get_state()
    table.start(layout=LAYOUT)
    table.act(lambda arms: pick_bar(arms, BAR))
    assert table.act(reach_through) == 2
    fallen = SE3.at(0.7, 0.2, CUBE_EDGE / 2)
    table.put(block=fallen)
    for state in (both, left):
        table.sim.set_state(state)
        assert table.judge() == 2


def test_a_block_that_fell_onto_the_mat_may_be_picked_up_and_put_down(table: TaskHarness) -> None:
    assert table.act(let_fall) == 3

    def again(arms: Arms) -> Script:
        yield from pick_lying(arms, LEFT, "block")
        yield from onto_mat(arms, LEFT, height=-0.006)

    table.act(again)
    assert table.hold(20) == 4


def test_only_a_block_that_rests_on_the_mat_counts(table: TaskHarness) -> None:
    table.act(hand_over)
    assert table.act(lambda arms: lower_onto_mat(arms, LEFT)) == 3
    assert on_mat_in_hand(table)
    beside = SE3.at(MAT[0], MAT[1] + HALF_MAT + 0.002, LYING_HEIGHT - 0.0002)
    table.put(mat=SE3.at(*MAT), block=beside)
    assert on_mat(table)
    assert table.stage == 3
    for _ in range(20):
        assert table.judge() == 3
    table.put(block=beside.moved(y=-0.004))
    assert on_mat(table)
    assert table.stage == 3, "it has not rested for half a second"


# --- objects -------------------------------------------------------------------------------------


def test_the_block_weighs_what_it_is_made_of(bench: TaskHarness) -> None:
    mass = bench.sim.model.body("block").mass[0]
    assert mass == pytest.approx(LONG_BLOCK * CUBE_EDGE**2 * PLA_DENSITY)


def test_the_ring_is_as_wide_as_the_task_says() -> None:
    axis = SE3.at(z=RING_HEIGHT) @ SE3.about((1, 0, 0), np.pi / 2)
    ring_on_stand = sum((manifold_of(shape) for shape in gate().shapes), manifold3d.Manifold())
    overlap = [
        (ring_on_stand ^ manifold_of(cylinder(radius, 0.1, at=axis))).volume()
        for radius in (RING_RADIUS, RING_RADIUS + RING_THICKNESS / 2)
    ]
    assert overlap[0] < 1e-12
    assert overlap[1] > 1e-6


@pytest.mark.parametrize(
    ("moved", "problem"),
    [
        ({"block": SE3.at(0.4, 0.07, CUBE_EDGE / 2)}, "overlap"),
        ({"gate": SE3.at(0.5, 0.25, 0.06)}, "touches the robot"),
        ({"gate": SE3.at(0.1, -0.5)}, "out of reach"),
    ],
    ids=["on the stand", "in the hand", "too close"],
)
def test_a_bad_place_for_the_fixed_ring_is_found(
    bench: TaskHarness, moved: dict[str, SE3], problem: str
) -> None:
    layout = Layout(poses={**LAYOUT.poses, **moved})
    assert any(problem in found for found in placement.problems(bench.sim, layout))


def test_ring_and_mat_stay_apart() -> None:
    """What is fixed does not collide with what is fixed: only the ranges keep them apart."""
    ring, mat = TASK.placements["gate"].y, TASK.placements["mat"].y
    assert ring.high + BASE[1] / 2 <= mat.low - MAT_EDGE / 2 + 1e-9
