import math

import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.tasks.stages.placing import PUT_HEIGHT
from duobench.tasks.stages.predicates import STILL_SPEED
from duobench.world.objects.blocks import CUBE_EDGE, LONG_BLOCK
from duobench.world.objects.bowl import FLOOR, RADIUS, RIM_HEIGHT
from duobench.world.sim.layout import Layout
from tests.steps import bring, by, do, drop, pause
from tests.task_harness import TaskHarness
from tests.ways.transfer_cube import both_hold, hand_over

LEFT, RIGHT = Side.LEFT, Side.RIGHT
BOWL = np.array([0.55, 0.15, 0.0])
"""Where both arms reach into the bowl."""
LOW_IN_BOWL = np.array([0.55, 0.15, 0.033])
LAYOUT = Layout(poses={"cube": SE3.at(0.45, -0.18, CUBE_EDGE / 2, yaw=0.3), "bowl": SE3.at(*BOWL)})
LYING = SE3.at(z=FLOOR + CUBE_EDGE / 2)
BESIDE = SE3.at(x=-RADIUS - 0.0155, z=LONG_BLOCK / 2) @ SE3.about((0, 1, 0), math.pi / 2)
"""Standing on the table, against the rim."""
ON_RIM = SE3.at(x=RADIUS - 0.001, z=RIM_HEIGHT + CUBE_EDGE / 2 - 0.0005)
TOO_HIGH = SE3.at(z=RIM_HEIGHT + PUT_HEIGHT + CUBE_EDGE / 2 + 0.001)


BRING = do(hand_over, (bring, LEFT, "cube", LOW_IN_BOWL))


def in_bowl(bench: TaskHarness) -> bool:
    """Whether the cube ended up in the bowl, so that a refused stage says something."""
    offset = bench.sim.position("cube") - bench.sim.position("bowl")
    touching = bench.sim.contacts.partners("cube")
    return bool(np.hypot(*offset[:2]) < RADIUS) and "bowl" in touching and "table" not in touching


# --- what must not count; what two arms can do of it is in tests/ways ----------------------------


def test_both_arms_hold_what_they_have_lifted(table: TaskHarness) -> None:
    """What both grasp on the table may lose contact with it for a step."""
    assert table.act(both_hold) == 2
    table.progress.reset(table.sim, {})  # As if the block had been so high from the start.
    assert table.judge() == 0


def test_a_block_that_is_still_held_in_the_bowl_does_not_count(table: TaskHarness) -> None:
    assert table.act(do(BRING, (pause, 30))) == 3
    assert in_bowl(table)
    assert max(table.sim.speed("cube")) < STILL_SPEED
    table.act(do((drop, LEFT)))
    assert table.hold(20) == 4


@pytest.mark.parametrize(
    "elsewhere",
    [BESIDE, BESIDE.moved(z=0.002), ON_RIM, TOO_HIGH],
    ids=["beside", "hanging outside", "on the rim", "too high"],
)
def test_a_block_that_left_the_bowl_again_does_not_count(
    table: TaskHarness, elsewhere: SE3
) -> None:
    table.act(BRING)
    table.put(cube=table.sim.pose("bowl") @ elsewhere)
    assert table.act(do((by, LEFT, {"z": 0.25}))) == 3  # the hand leaves the bowl
    table.put(cube=table.sim.pose("bowl") @ LYING)
    assert table.hold(20) == 3
    assert in_bowl(table)
    assert max(table.sim.speed("cube")) < STILL_SPEED
