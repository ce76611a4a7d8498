import numpy as np
import pytest

from duobench.experts.handling import LET_GO
from duobench.experts.motion import Arms, Script, move, release, together, wait
from duobench.experts.scripts.hinge_chest import HOLDER, INSERTER, fetch, lower, open_lid, script
from duobench.objects.blocks import CUBE_EDGE
from duobench.objects.chest import LID_LIMITS, OUTER_Y, RIM_HEIGHT, WALL
from duobench.spatial import SE3
from duobench.stages.placing import REST_SECONDS
from duobench.tasks.hinge_chest import OPEN_ANGLE
from duobench.types import CONTROL_HZ
from tests.task_harness import TaskHarness, set_hinge

LID = "chest/lid"
HALF = CUBE_EDGE / 2
REST_STEPS = round(REST_SECONDS * CONTROL_HZ)
ON_FLOOR = WALL + HALF - 0.0001
"""Height of a cube that touches the chest's floor."""


def in_chest(bench: TaskHarness, x: float, y: float, z: float) -> SE3:
    return bench.sim.pose("chest") @ SE3.at(x, y, z)


def test_the_expert_holds_the_lid_with_its_gripper_clear_of_the_stop(bench: TaskHarness) -> None:
    bench.start(0)
    highest = 0.0
    for stage in bench.steps(script):
        highest = max(highest, bench.sim.angle(LID))
        if stage == 2:
            assert bench.sim.contacts.gripper(HOLDER, LID)
            assert not bench.sim.contacts.arm(INSERTER, LID)
    assert highest < LID_LIMITS[1] - 0.02


# --- where the cube must be; who brings it, and how, is in tests/stages/test_support.py ---------


def cube_put_in(bench: TaskHarness) -> None:
    """An episode in which the cube was put into the chest, and has not rested there for long."""

    def press(arms: Arms) -> Script:
        yield from together(open_lid(arms), fetch(arms))
        yield from lower(arms)
        yield from move(arms, {INSERTER: arms.targets[INSERTER].moved(z=-0.012)})
        yield from wait(10)
        yield from release(arms, INSERTER, opening=LET_GO)

    contacts = bench.sim.contacts
    bench.start(0)
    bench.run_until(
        press,
        lambda: contacts.between("cube", "chest") and not contacts.gripper(INSERTER, "cube"),
    )
    assert bench.stage == 2


@pytest.mark.parametrize(
    ("place", "stage"),
    [
        ((0.0, -0.06, ON_FLOOR), 3),
        ((0.0, -0.06, ON_FLOOR + 0.010), 2),
        ((0.0, OUTER_Y / 2 + HALF - 0.0002, HALF), 2),
        ((0.0, -OUTER_Y / 2 - HALF + 0.0002, HALF), 2),
        ((0.0, OUTER_Y / 2 - WALL - 0.001, RIM_HEIGHT + HALF - 0.0002), 2),
    ],
    ids=["on the floor", "in the air", "beside", "on the other side", "across the rim"],
)
def test_only_a_cube_on_the_floor_of_the_chest_counts(
    bench: TaskHarness, place: tuple[float, float, float], stage: int
) -> None:
    cube_put_in(bench)
    for _ in range(2 * REST_STEPS):
        bench.put(cube=in_chest(bench, *place))
    assert bench.stage == stage


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.3), (0.1, 0.0, 0.0)])
def test_a_cube_that_moves_in_the_chest_does_not_count(
    bench: TaskHarness, velocity: tuple[float, float, float]
) -> None:
    cube_put_in(bench)
    resting = bench.sim.pose("cube")
    for _ in range(2 * REST_STEPS):
        bench.sim.place("cube", resting)
        bench.push("cube", *velocity)
        assert bench.judge() == 2
        assert bench.sim.contacts.between("cube", "chest")
    bench.sim.place("cube", resting)
    bench.sim.forward()
    assert bench.hold(REST_STEPS + 5) == 3


# --- physics and objects -------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.1, 0.2, OPEN_ANGLE, 1.2, LID_LIMITS[1]])
def test_the_lid_falls_shut_within_a_second(bench: TaskHarness, angle: float) -> None:
    bench.start(0)
    set_hinge(bench.sim, LID, angle)
    bench.hold(1)
    assert bench.sim.angle(LID) < angle
    bench.hold(28)
    assert bench.sim.angle(LID) < 0.01


def test_its_weight_alone_shuts_the_lid(bench: TaskHarness) -> None:
    bench.start(0)
    joint = bench.sim.model.joint(LID)
    assert joint.stiffness[0] == 0.0
    for angle in np.linspace(*LID_LIMITS, 5):
        set_hinge(bench.sim, LID, float(angle))
        assert bench.sim.data.qfrc_passive[joint.dofadr[0]] == 0.0
        # In N·m: what is left of it at the stop is many times what a screw's friction takes.
        assert bench.sim.data.qfrc_bias[joint.dofadr[0]] > 0.04


def test_the_lid_goes_no_further_than_its_stop(bench: TaskHarness) -> None:
    bench.start(0)
    set_hinge(bench.sim, LID, OPEN_ANGLE, 20.0)
    highest = 0.0
    for _ in range(30):
        bench.hold(1)
        highest = max(highest, bench.sim.angle(LID))
    assert highest == pytest.approx(LID_LIMITS[1], abs=0.03)
    assert bench.sim.angle(LID) < 0.01


def test_the_cavity_is_empty_and_as_large_as_the_task_says(bench: TaskHarness) -> None:
    bench.start(0)
    inset = HALF + 0.0005
    for x in (-0.065 + inset, 0.065 - inset):
        for y in (-0.115 + inset, 0.115 - inset):
            for z in (ON_FLOOR + 0.0005, RIM_HEIGHT - inset):
                bench.put(cube=in_chest(bench, x, y, z))
                assert bench.sim.contacts.partners("cube") == set()
    bench.put(cube=in_chest(bench, 0.065 - HALF + 0.001, 0.0, ON_FLOOR))
    assert bench.sim.contacts.between("cube", "chest")
