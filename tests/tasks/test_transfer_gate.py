import manifold3d
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.experts.handover import pick_bar
from duobench.tasks.experts.motion import down, grip
from duobench.tasks.experts.scripts.transfer_gate import BAR, lower_onto_mat
from duobench.tasks.transfer_gate import CROSSING_RADIUS, TASK
from duobench.world.objects import gate as gates
from duobench.world.objects.blocks import CUBE_EDGE
from duobench.world.objects.shapes import cylinder
from duobench.world.objects.solid import manifold_of
from duobench.world.sim import placement
from duobench.world.sim.layout import Layout
from tests.steps import do, drop, pause, to
from tests.task_harness import TaskHarness
from tests.ways.transfer_gate import hand_over

LEFT, RIGHT = Side.LEFT, Side.RIGHT
MAT = np.array([0.5, 0.22, gates.MAT_THICKNESS / 2])
"""Where both arms reach the mat."""
HALF_MAT = gates.MAT_EDGE / 2
LYING_HEIGHT = gates.MAT_THICKNESS + CUBE_EDGE / 2
LAYOUT = Layout(
    poses={
        "block": SE3.at(0.5, -0.25, CUBE_EDGE / 2, yaw=0.3),
        "gate": SE3.at(0.4, 0.0),
        "mat": SE3.at(*MAT),
    }
)


def slide_gate_over_block(bench: TaskHarness, *, aside: float = 0.0) -> None:
    """Let the block cross the ring, in whatever hand, by moving the ring."""
    x, y, z = bench.sim.position("block")
    for beyond in (-0.02, 0.02):
        bench.put(gate=SE3.at(x - aside, y - beyond, z - gates.RING_HEIGHT))


def on_mat(bench: TaskHarness) -> bool:
    """Whether the block ended up on the mat, so that a refused stage says something."""
    return bench.sim.contacts.partners("block") == {"mat"}


def on_mat_in_hand(bench: TaskHarness) -> bool:
    contacts = bench.sim.contacts
    return contacts.grasped(LEFT, "block") and contacts.between("block", "mat")


# --- what must not count; what two arms can do of it is in tests/ways ----------------------------


@pytest.mark.parametrize(
    ("aside", "stage"),
    [(0.0, 2), (CROSSING_RADIUS - 0.002, 2), (CROSSING_RADIUS + 0.002, 1), (0.2, 1)],
)
def test_the_plane_must_be_crossed_inside_the_ring(
    table: TaskHarness, aside: float, stage: int
) -> None:
    assert table.act(do((pick_bar, BAR))) == 1
    slide_gate_over_block(table, aside=aside)
    assert table.stage == stage


def test_crossing_on_the_table_does_not_count(table: TaskHarness) -> None:
    x, y, z = table.sim.position("block")
    above, low = (down(x, y, z + height, yaw=0.3) for height in (0.1, 0.012))
    table.act(do((to, RIGHT, above), (to, RIGHT, low), (grip, RIGHT)))
    assert table.sim.contacts.grasped(RIGHT, "block")
    assert table.sim.contacts.between("block", "table")
    slide_gate_over_block(table)
    assert table.stage == 0


def test_a_block_that_is_still_held_on_the_mat_does_not_count(table: TaskHarness) -> None:
    assert table.act(do(hand_over, (lower_onto_mat, LEFT), (pause, 20))) == 3
    assert on_mat_in_hand(table)
    table.act(do((drop, LEFT)))
    assert table.hold(20) == 4


def test_only_a_block_that_rests_on_the_mat_counts(table: TaskHarness) -> None:
    assert table.act(do(hand_over, (lower_onto_mat, LEFT))) == 3
    assert on_mat_in_hand(table)
    beside = SE3.at(MAT[0], MAT[1] + HALF_MAT + 0.002, LYING_HEIGHT - 0.0002)
    table.put(mat=SE3.at(*MAT), block=beside)
    assert on_mat(table)
    assert table.stage == 3
    assert table.rest(20) == 3
    table.put(block=beside.moved(y=-0.004))
    assert on_mat(table)
    assert table.stage == 3, "it has not rested for half a second"


# --- objects -------------------------------------------------------------------------------------


def test_the_ring_is_as_wide_as_the_task_says() -> None:
    axis = SE3.at(z=gates.RING_HEIGHT) @ SE3.about((1, 0, 0), np.pi / 2)
    ring_on_stand = sum(map(manifold_of, gates.gate().shapes), manifold3d.Manifold())
    overlap = [
        (ring_on_stand ^ manifold_of(cylinder(radius, 0.1, at=axis))).volume()
        for radius in (gates.RING_RADIUS, gates.RING_RADIUS + gates.RING_THICKNESS / 2)
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
    assert ring.high + gates.BASE[1] / 2 <= mat.low - gates.MAT_EDGE / 2 + 1e-9
