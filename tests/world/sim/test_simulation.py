"""State, stepping, settling and questions about props."""

import copy
import math
import pickle
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from duobench.core.errors import DuoBenchError, SimulationError, UnknownNameError
from duobench.core.spatial import SE3
from duobench.core.types import DuoCommand
from duobench.world.objects.blocks import RED, cube
from duobench.world.objects.cup import cup
from duobench.world.objects.prop import Prop
from duobench.world.robot.frames import ROBOT
from duobench.world.sim.questions import CLEARLY
from duobench.world.sim.simulation import MAX_SETTLE_STEPS, Simulation
from tests.world.sim.props import EDGE, LID, REST, scene


@pytest.fixture(scope="module")
def shared() -> Simulation:
    return scene()


@pytest.fixture
def sim(shared: Simulation) -> Simulation:
    """The scene at rest, however it was left."""
    begin(shared)
    return shared


def begin(sim: Simulation) -> None:
    sim.reset_data()
    for name, pose in REST.items():
        sim.place(name, pose)
    sim.forward()
    sim.settle()


def busy(number: int) -> DuoCommand:
    """Commands that swing the arms over the table and work the grippers."""
    joints = ROBOT.home_command.joints + 0.3 * math.sin(0.4 * number)
    return DuoCommand(joints=joints, openings=np.full(2, 0.5 + 0.5 * math.cos(0.5 * number)))


def played(sim: Simulation, numbers: Iterable[int]) -> list[np.ndarray]:
    """The states after each of some commands."""
    states = []
    for number in numbers:
        sim.step(busy(number))
        states.append(sim.get_state())
    return states


def falling(sim: Simulation) -> None:
    """Something with many contacts is going on."""
    sim.place("cube", SE3.at(0.7, 0.3, 0.15, yaw=0.4))
    sim.place("slab", SE3(SE3.about((1, 2, 3), 1.0).rotation, np.array([0.72, 0.3, 0.3])))
    sim.forward()


@pytest.mark.parametrize("prepare", [begin, falling], ids=["at rest", "falling"])
@pytest.mark.parametrize("at", [0, 1, 7])
def test_restoring_and_stepping_is_the_uninterrupted_episode(
    sim: Simulation, prepare: Callable[[Simulation], None], at: int
) -> None:
    prepare(sim)
    played(sim, range(at))
    state = sim.get_state()
    straight = played(sim, range(at, at + 12))
    begin(sim)
    falling(sim)
    played(sim, range(0, 27, 3))
    sim.set_state(state)
    assert np.array_equal(sim.get_state(), state)
    for number, restored in enumerate(played(sim, range(at, at + 12))):
        assert np.array_equal(restored, straight[number]), f"step {number} differs"


def test_restoring_brings_poses_and_contacts_along(sim: Simulation) -> None:
    state, pose = sim.get_state(), sim.pose("cube")
    sim.place("cube", SE3.at(0.5, 0.1, 0.5))
    sim.forward()
    assert not sim.contacts.between("cube", "table")
    sim.set_state(state)
    assert sim.contacts.between("cube", "table")
    assert sim.pose("cube").distance(pose) == (0.0, 0.0)


@pytest.mark.parametrize("size", [-1, 1])
def test_a_state_of_another_model_is_refused(sim: Simulation, size: int) -> None:
    with pytest.raises(SimulationError, match="another task or version"):
        sim.set_state(np.zeros(len(sim.get_state()) + size))


def test_clearing_forgets_everything(sim: Simulation) -> None:
    sim.reset_data()
    first = sim.get_state().tobytes()
    begin(sim)
    falling(sim)
    played(sim, range(6))
    sim.reset_data()
    assert sim.get_state().tobytes() == first
    assert np.array_equal(sim.duo.command().flat, ROBOT.home_command.flat)


def test_after_a_step_everything_is_up_to_date(sim: Simulation) -> None:
    falling(sim)
    played(sim, range(5))
    pose, touching = sim.pose("cube"), sim.contacts.partners("cube")
    sim.forward()
    assert sim.pose("cube").distance(pose) == (0.0, 0.0)
    assert sim.contacts.partners("cube") == touching


def test_settling_ends_at_rest_at_time_zero(sim: Simulation) -> None:
    sim.place("cube", SE3.at(0.5, 0.1, EDGE / 2 + 0.005))
    sim.forward()
    steps = sim.settle()
    assert 1 < steps < MAX_SETTLE_STEPS
    assert sim.data.time == 0.0
    assert sim.contacts.between("cube", "table")
    speed, turn = sim.speed("cube")
    assert speed < 0.01
    assert turn < 0.5


def test_settling_is_bounded(sim: Simulation) -> None:
    sim.place("cube", SE3.at(0.5, 0.1, 30.0))
    sim.forward()
    assert sim.settle() == MAX_SETTLE_STEPS
    assert Simulation().settle() == 1, "nothing is free"


def test_props_are_placed_where_they_are_told_at_rest(sim: Simulation) -> None:
    falling(sim)
    for _ in range(4):
        sim.step(ROBOT.home_command)
    assert sim.speed("cube")[0] > 0.3
    for name in REST:
        pose = SE3.at(0.4, 0.1, 0.6, yaw=-0.7) @ SE3.about((1, 0, 0), 0.5)
        sim.place(name, pose)
        sim.forward()
        assert max(sim.pose(name).distance(pose)) < 1e-9
        assert sim.speed(name) == (0.0, 0.0)


def test_fixed_props_stay(sim: Simulation) -> None:
    sim.place("cube", SE3.at(0.7, -0.3, 0.2))
    sim.forward()
    for _ in range(15):
        sim.step(ROBOT.home_command)
    assert sim.data.time == pytest.approx(0.5), "a step takes a thirtieth of a second"
    assert max(sim.pose("chest").distance(REST["chest"])) < 1e-9
    assert sim.speed("chest") == (0.0, 0.0)


def test_relative_positions(sim: Simulation) -> None:
    expected = sim.pose("chest").inverse().apply(sim.position("cube"))
    assert sim.relative_position("cube", "chest") == pytest.approx(expected)
    assert sim.relative_position("cube", "cube") == pytest.approx((0, 0, 0))


def test_the_lowest_point_of_a_tilted_block(sim: Simulation) -> None:
    tilt = 0.4
    sim.place("slab", SE3.at(0.5, -0.2, 0.2) @ SE3.about((0, 1, 0), tilt))
    sim.forward()
    expected = 0.2 - 0.05 * math.sin(tilt) - 0.01 * math.cos(tilt)
    assert sim.min_height("slab") == pytest.approx(expected)


def test_speed_of_a_falling_and_turning_prop(sim: Simulation) -> None:
    sim.place("cube", SE3.at(0.5, 0.1, 1.5))
    start = sim.model.joint("cube").dofadr[0]
    sim.data.qvel[start : start + 6] = [0.3, 0.0, 0.4, 0.0, 2.0, 0.0]
    assert sim.speed("cube") == pytest.approx((0.5, 2.0))


@pytest.mark.parametrize("own", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.1)])
def test_what_moves_along_with_a_turning_prop_is_at_rest_on_it(
    sim: Simulation, own: tuple[float, float, float]
) -> None:
    slab = SE3.at(0.5, 0.0, 0.5, yaw=0.7) @ SE3.about((1.0, 2.0, 3.0), 0.9)
    at, linear, turn = np.array([0.04, -0.03, 0.05]), np.array([0.2, 0.5, -0.4]), [1.0, -2.0, 3.0]
    sim.place("slab", slab)
    sim.place("cube", slab @ SE3.at(*at))
    velocities = {"slab": linear, "cube": linear + slab.rotation @ (np.cross(turn, at) + own)}
    for name, velocity in velocities.items():
        start = sim.model.joint(name).dofadr[0]
        sim.data.qvel[start : start + 6] = [*velocity, *turn]
    sim.forward()
    assert sim.relative_speed("cube", "slab") == pytest.approx(math.hypot(*own), abs=1e-9)
    assert sim.relative_speed("cube", "chest") == pytest.approx(sim.speed("cube")[0])


def test_many_props_are_looked_at_together_as_each_one_alone(sim: Simulation) -> None:
    names = "cube", "slab"
    cylinder = {"radius": 0.3, "low": -0.2, "high": 0.25}
    falling(sim)
    seen = set[bool]()
    slow = set[bool]()
    for number in range(20):
        sim.step(busy(number))
        for frame in ("chest", *names):
            alone = [sim.relative_position(name, frame) for name in names]
            inside = {
                number: z
                for number, (x, y, z) in enumerate(alone)
                if math.hypot(x, y) <= 0.3 and -0.2 <= z <= 0.25
            }
            assert sim.heights_inside(names, frame, **cylinder) == inside
            seen.add(len(inside) == 2)
            speeds = [sim.relative_speed(name, frame) for name in names]
            within = max(math.hypot(*one) for one in alone)
            limit = 0.05 * number
            clearly = sim.are_slower(names, frame, limit, within=within)
            assert not clearly or max(speeds) < limit
            slow.add(clearly)
    assert seen == slow == {True, False}


def test_a_height_lies_between_its_bounds() -> None:
    props = {"cup": cup((1.0, 1.0, 1.0, 1.0)), "cube": cube(RED)}
    sim = Simulation([Prop(name=name, solid=solid) for name, solid in props.items()])
    for tilt in np.linspace(0.0, math.pi, 20):
        for x, name in enumerate(props):
            sim.place(name, SE3.at(0.3 * x, 0.0, 0.3) @ SE3.about((1.0, 0.4, 0.2), tilt))
        sim.forward()
        for name in props:
            bounds = sim.height_bounds(name)
            assert bounds is not None
            lowest, highest = bounds
            assert lowest - CLEARLY < sim.min_height(name) < highest + CLEARLY
            assert highest - lowest < 0.1


def test_the_angle_of_a_hinge(sim: Simulation) -> None:
    assert sim.angle(LID) == pytest.approx(0.0, abs=0.01)
    sim.data.qpos[sim.model.joint(LID).qposadr[0]] = 0.7
    assert sim.angle(LID) == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda sim: sim.position("cbue"), "'cbue'"),
        (lambda sim: sim.pose("cbue"), "'cbue'"),
        (lambda sim: sim.place("cbue", SE3()), "'cbue'"),
        (lambda sim: sim.relative_position("cube", "cbue"), "'cbue'"),
        (lambda sim: sim.relative_speed("cube", "cbue"), "'cbue'"),
        (lambda sim: sim.relative_speed("cbue", "cube"), "'cbue'"),
        (lambda sim: sim.speed("cbue"), "'cbue'"),
        (lambda sim: sim.speed("table"), "object 'table'"),
        (lambda sim: sim.speed(LID), f"object '{LID}'"),
        (lambda sim: sim.min_height("cbue"), "'cbue'"),
        (lambda sim: sim.min_height("table"), "object 'table'"),
        (lambda sim: sim.min_height(LID), f"object '{LID}'"),
        (lambda sim: sim.angle("cbue"), "'cbue'"),
        (lambda sim: sim.angle("cube"), f"hinge 'cube'.*{LID}"),
        (lambda sim: sim.site_pose("cbue"), "'cbue'"),
    ],
)
def test_unknown_names_are_errors(
    sim: Simulation, ask: Callable[[Simulation], object], words: str
) -> None:
    with pytest.raises(UnknownNameError, match=words):
        ask(sim)


@pytest.mark.parametrize("copied", [pickle.dumps, copy.copy, copy.deepcopy])
def test_a_simulation_says_that_it_cannot_be_copied(
    sim: Simulation, copied: Callable[[Simulation], object]
) -> None:
    with pytest.raises(DuoBenchError, match=r"cannot be pickled or copied.*save_state"):
        copied(sim)


def test_two_props_of_one_name_are_refused() -> None:
    with pytest.raises(DuoBenchError, match="its own name"):
        Simulation([Prop(name="cube", solid=cube(RED))] * 2)
