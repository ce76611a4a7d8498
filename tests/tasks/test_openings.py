"""The chest with a lid and the oven with a door: where the cube must be, and their physics.

Who brings it, and how, is in tests/tasks/stages/test_support.py.
"""

import itertools

import mujoco
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ
from duobench.tasks import catalog
from duobench.tasks.experts.handling import LET_GO
from duobench.tasks.experts.motion import Arms, Script, move, release, together, wait
from duobench.tasks.experts.scripts.hinge_chest import script
from duobench.tasks.stages.placing import REST_SECONDS
from duobench.world.objects import chest, microwave
from duobench.world.objects.blocks import CUBE_EDGE
from duobench.world.objects.microwave import CAVITY_CENTRE_Y, DOOR_LIMITS, FRONT
from tests.task_harness import TaskHarness, set_hinge
from tests.ways.hinge_chest import CHEST
from tests.ways.opening import Opening
from tests.ways.spring_door import DOOR, Putting, done, put_in

CASES = {"hinge_chest": CHEST, "spring_door": DOOR}
HALF = CUBE_EDGE / 2
INSET = HALF + 0.0005
REST_STEPS = round(REST_SECONDS * CONTROL_HZ) + 1
IN_CHEST, IN_OVEN = chest.WALL + HALF - 0.0001, microwave.FLOOR + HALF - 0.0001
"""Heights of a cube that touches the floor of the chest and of the oven, in metres."""
CHEST_WALL, BEHIND = chest.OUTER_Y / 2, microwave.DEPTH / 2 + HALF - 0.0001
OVEN_WALL = CAVITY_CENTRE_Y + microwave.CAVITY[1] / 2 - HALF + 0.0001
ROOF = microwave.HEIGHT + HALF - 0.0001


@pytest.fixture(scope="module")
def benches() -> dict[str, TaskHarness]:
    return {task: TaskHarness(catalog.get(task)) for task in CASES}


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> Opening:
    return CASES[request.param]


@pytest.fixture
def bench(benches: dict[str, TaskHarness], case: Opening) -> TaskHarness:
    bench = next(benches[task] for task, one in CASES.items() if one is case)
    bench.start(0)
    return bench


def rows(**of_task: list[tuple]) -> pytest.MarkDecorator:
    """Values of `row` for each task, which bring `case` along."""
    values = [(CASES[task], row) for task, listed in of_task.items() for row in listed]
    return pytest.mark.parametrize(("case", "row"), values, ids=lambda value: str(value)[:60])


def inside(bench: TaskHarness, case: Opening, x: float, y: float, z: float) -> SE3:
    return bench.sim.pose(case.fixture) @ SE3.at(x, y, z)


def let_go_inside(bench: TaskHarness, case: Opening) -> None:
    """The cube has just been let go on the floor: all but rest."""

    def press(arms: Arms) -> Script:
        yield from together(case.opens(arms), case.fetches(arms))
        yield from case.puts_in(arms)
        yield from move(arms, {case.bringer: arms.targets[case.bringer].moved(z=-0.012)})
        yield from wait(10)
        yield from release(arms, case.bringer, opening=LET_GO)

    contacts = bench.sim.contacts
    bench.run_until(
        press,
        lambda: (
            contacts.between("cube", case.fixture) and not contacts.gripper(case.bringer, "cube")
        ),
    )
    assert bench.stage == 2


@pytest.mark.slow
@rows(
    hinge_chest=[
        ((0.0, -0.06, IN_CHEST), True, 3),
        ((0.0, -0.06, IN_CHEST + 0.010), False, 2),
        ((0.0, CHEST_WALL + HALF - 0.0002, HALF), True, 2),  # beside it, on either side
        ((0.0, -CHEST_WALL - HALF + 0.0002, HALF), True, 2),
        ((0.0, CHEST_WALL - chest.WALL - 0.001, chest.RIM_HEIGHT + HALF - 0.0002), True, 2),
    ],
    spring_door=[
        ((0.0, CAVITY_CENTRE_Y, IN_OVEN), True, 3),
        ((0.0, CAVITY_CENTRE_Y, ROOF), True, 2),
        ((BEHIND, CAVITY_CENTRE_Y, IN_OVEN + 0.0001), True, 2),
        ((BEHIND, CAVITY_CENTRE_Y, HALF), True, 2),
        ((FRONT + HALF - 0.002, CAVITY_CENTRE_Y, IN_OVEN), True, 2),  # out of the front
        ((0.0, CAVITY_CENTRE_Y, IN_OVEN + 0.0041), False, 2),
        ((0.0, OVEN_WALL, microwave.FLOOR + 0.12), True, 2),
    ],
)
def test_only_a_cube_on_the_floor_counts(bench: TaskHarness, case: Opening, row: tuple) -> None:
    place, touches, stage = row
    let_go_inside(bench, case)
    for _ in range(2 * REST_STEPS):
        bench.put(cube=inside(bench, case, *place))
    assert bench.sim.angle(case.lid) > case.open_angle
    assert bench.sim.contacts.between("cube", case.fixture) == touches
    assert bench.stage == stage


@rows(hinge_chest=[(0.0, 0.0, 0.3), (0.1, 0.0, 0.0)], spring_door=[(0.1, 0.0, 0.0)])
def test_a_cube_that_moves_inside_does_not_count(
    bench: TaskHarness, case: Opening, row: tuple
) -> None:
    let_go_inside(bench, case)
    resting = bench.sim.pose("cube")
    for _ in range(2 * REST_STEPS):
        bench.sim.place("cube", resting)
        bench.push("cube", *row)
        assert bench.judge() == 2
        assert bench.sim.contacts.between("cube", case.fixture)
    bench.sim.place("cube", resting)
    bench.sim.forward()
    assert bench.hold(REST_STEPS + 5) == 3


@pytest.mark.parametrize("case", [DOOR], ids=["spring_door"])
def test_a_cube_that_is_let_go_high_above_the_floor_does_not_count(bench: TaskHarness) -> None:
    bench.act(lambda arms: put_in(arms, Putting(drop=0.12, slope=1.0)))
    bench.hold(30)
    assert done(bench.sim)
    assert bench.stage == 2


@pytest.mark.parametrize("case", [CHEST], ids=["hinge_chest"])
def test_the_expert_holds_the_lid_with_its_gripper_clear_of_the_stop(
    bench: TaskHarness, case: Opening
) -> None:
    highest = 0.0
    for stage in bench.steps(script):
        highest = max(highest, bench.sim.angle(case.lid))
        if stage == 2:
            assert bench.sim.contacts.gripper(case.holder, case.lid)
            assert not bench.sim.contacts.arm(case.bringer, case.lid)
    assert highest < chest.LID_LIMITS[1] - 0.02


@rows(
    hinge_chest=[
        (angle, 0.0, 29, 0.01) for angle in (0.1, 0.2, CHEST.open_angle, 1.2, chest.LID_LIMITS[1])
    ],
    spring_door=[(angle, 0.5, 60, 0.02) for angle in (0.3, DOOR.open_angle, 1.5, DOOR_LIMITS[1])],
)
def test_it_shuts_by_itself(bench: TaskHarness, case: Opening, row: tuple) -> None:
    """The lid within a second, the door within two and not in one jerk."""
    angle, share, steps, shut = row
    set_hinge(bench.sim, case.lid, angle)
    bench.hold(1)
    assert share * angle < bench.sim.angle(case.lid) < angle
    bench.hold(steps - 1)
    assert bench.sim.angle(case.lid) < shut


@pytest.mark.parametrize("case", [CHEST], ids=["hinge_chest"])
def test_its_weight_alone_shuts_the_lid(bench: TaskHarness, case: Opening) -> None:
    joint = bench.sim.model.joint(case.lid)
    assert joint.stiffness[0] == 0.0
    for angle in np.linspace(*chest.LID_LIMITS, 5):
        set_hinge(bench.sim, case.lid, float(angle))
        assert bench.sim.data.qfrc_passive[joint.dofadr[0]] == 0.0
        # In N·m: what is left of it at the stop is many times what a screw's friction takes.
        assert bench.sim.data.qfrc_bias[joint.dofadr[0]] > 0.04


@pytest.mark.parametrize("case", [CHEST], ids=["hinge_chest"])
def test_the_lid_goes_no_further_than_its_stop(bench: TaskHarness, case: Opening) -> None:
    set_hinge(bench.sim, case.lid, case.open_angle, 20.0)
    highest = 0.0
    for _ in range(30):
        bench.hold(1)
        highest = max(highest, bench.sim.angle(case.lid))
    assert highest == pytest.approx(chest.LID_LIMITS[1], abs=0.03)
    assert bench.sim.angle(case.lid) < 0.01


@pytest.mark.parametrize("case", [DOOR], ids=["spring_door"])
def test_the_door_clears_the_oven_at_every_angle(bench: TaskHarness, case: Opening) -> None:
    """The engine lets a body and the one that carries it overlap, so distances are asked for."""
    model, data = bench.sim.model, bench.sim.data
    oven, door = (
        [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_contype[g]]
        for body in map(bench.sim.body_id, (case.fixture, case.lid))
    )
    for angle in np.linspace(*DOOR_LIMITS, 20):
        set_hinge(bench.sim, case.lid, float(angle))
        for one, other in itertools.product(oven, door):
            assert mujoco.mj_geomDistance(model, data, one, other, 0.1, None) > 0.0


@rows(
    hinge_chest=[
        ((-0.065, 0.065), (-0.115, 0.115), (IN_CHEST - HALF, chest.RIM_HEIGHT)),
    ],
    spring_door=[
        ((FRONT, FRONT + 0.26), (CAVITY_CENTRE_Y - 0.165, CAVITY_CENTRE_Y + 0.165), (0.03, 0.27)),
    ],
)
def test_the_cavity_is_empty_and_as_large_as_the_task_says(
    bench: TaskHarness, case: Opening, row: tuple
) -> None:
    for corner in itertools.product(*((low + INSET, high - INSET) for low, high in row)):
        bench.put(cube=inside(bench, case, *corner))
        assert bench.sim.contacts.partners("cube") == set()
    (_, beyond), (low, high), (floor, _) = row
    bench.put(cube=inside(bench, case, beyond - HALF + 0.001, (low + high) / 2, floor + HALF))
    assert bench.sim.contacts.between("cube", case.fixture)
