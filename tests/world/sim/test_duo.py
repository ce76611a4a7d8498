"""Commands in, state out; and names to ids: a misspelt one fails at once."""

import math

import mujoco
import numpy as np
import pytest

from duobench.core.errors import DuoBenchError, UnknownNameError
from duobench.core.spatial import SE3
from duobench.core.types import CONTROL_HZ, SIDES, DuoCommand, Side
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS
from duobench.world.scene.compose import SUBSTEPS, compose
from duobench.world.scene.naming import arm_joint_names, pad_names, tcp_name
from duobench.world.sim.duo import Duo, names_of, resolve
from duobench.world.sim.simulation import Simulation
from tests.world.sim.props import hold, scene

GRIPPER = ROBOT.gripper


@pytest.fixture(scope="module")
def shared() -> Simulation:
    return Simulation()


@pytest.fixture
def sim(shared: Simulation) -> Simulation:
    shared.reset_data()
    shared.forward()
    return shared


def command(left: float = 0.0, right: float = 0.0, opening: float = 1.0) -> DuoCommand:
    joints = ROBOT.home_command.joints + np.array([[left], [right]])
    return DuoCommand(joints=joints, openings=np.full(2, opening))


def test_a_model_without_the_robot_is_refused() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(UnknownNameError, match="left/joint1"):
        Duo(model, mujoco.MjData(model), ROBOT)


def test_actuators_in_another_order_are_refused() -> None:
    spec = compose()
    joint = arm_joint_names(SIDES[0])[2]
    spec.delete(spec.actuator(joint))
    spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    model = spec.compile()
    with pytest.raises(DuoBenchError, match="follow each other"):
        Duo(model, mujoco.MjData(model), ROBOT)


def ramped(sim: Simulation, goal: DuoCommand) -> np.ndarray:
    """Controls of each substep."""
    return np.array([sim.data.ctrl.copy() for _ in sim.duo.interpolate(goal)])


def test_targets_move_linearly_over_the_step(sim: Simulation) -> None:
    start = sim.data.ctrl.copy()
    rows = ramped(sim, command(left=0.16, right=-0.08, opening=0.5))
    assert rows.shape == (SUBSTEPS, 16)
    end = rows[-1]
    assert end[[0, 8]] - start[[0, 8]] == pytest.approx([0.16, -0.08])
    assert end[[7, 15]] == pytest.approx([127.5, 127.5])
    for number, row in enumerate(rows, start=1):
        assert row == pytest.approx(start + (end - start) * number / SUBSTEPS)
    goal = command(left=0.1, opening=0.3)
    sim.step(goal)
    assert np.ptp(ramped(sim, goal), axis=0).max() == 0.0, "a repeated command is no ramp"


def test_a_command_can_be_read_back_exactly(sim: Simulation) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        joints = ROBOT.home_command.joints + rng.uniform(-0.1, 0.1, size=(2, 7))
        sent = DuoCommand(joints=joints, openings=rng.uniform(size=2))
        sim.step(sent)
        assert np.array_equal(sim.duo.command().joints, sent.joints)
        assert sim.duo.command().openings == pytest.approx(sent.openings, abs=1e-12)


def test_states_and_commands_are_copies(sim: Simulation) -> None:
    read, state = sim.duo.command(), sim.duo.read()
    kept = read.flat, state.flat.copy(), state.tcp_poses.copy()
    for _ in range(5):
        sim.step(command(left=0.2, opening=0.0))
    for one, other in zip((read.flat, state.flat, state.tcp_poses), kept, strict=True):
        assert np.array_equal(one, other)


def test_the_arms_follow_and_each_is_its_own(sim: Simulation) -> None:
    goal = command(left=0.2)
    for _ in range(30):
        state = sim.step(goal)
    assert state.joints == pytest.approx(goal.joints, abs=0.01)
    assert np.abs(state.joints[1] - HOME_JOINTS[1]).max() < 0.002


@pytest.mark.parametrize("opening", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_the_grippers_open_as_far_as_told(sim: Simulation, opening: float) -> None:
    for _ in range(25):
        state = sim.step(command(opening=opening))
    assert state.openings == pytest.approx([opening] * 2, abs=0.03)
    assert np.all((state.openings >= 0) & (state.openings <= 1))


def gap(sim: Simulation) -> float:
    """Distance in metres between the pads of the left gripper."""
    left, right = (sim.position(name) for name in pad_names(Side.LEFT, GRIPPER))
    opening = sim.site_pose(tcp_name(Side.LEFT)).rotation[:, 1]
    return abs(float((left - right) @ opening))


@pytest.mark.parametrize("opening", [0.0, 0.5, 1.0])
def test_fingers_move_at_the_speed_of_a_real_gripper(sim: Simulation, opening: float) -> None:
    """The data sheet's 150 mm/s at most, and not much less."""
    for _ in range(30):
        sim.step(command(opening=1.0 - opening))
    gaps = [gap(sim)]
    for _ in range(30):
        sim.step(command(opening=opening))
        gaps.append(gap(sim))
    speeds = np.abs(np.diff(gaps)) * CONTROL_HZ
    assert speeds.max() <= GRIPPER.speeds[1]
    if opening != 0.5:
        assert abs(gaps[-1] - gaps[0]) == pytest.approx(GRIPPER.stroke, abs=0.003)
        assert speeds[2:12].mean() > 0.7 * GRIPPER.speeds[1]


@pytest.mark.parametrize("opening", [0.0, 0.1, 0.2])
def test_fingers_press_with_a_set_force(opening: float) -> None:
    """Whatever opening is commanded, as long as it is narrower than what they hold."""
    sim = scene()
    hold(sim, "cube", steps=25, opening=opening)
    for pad in pad_names(Side.LEFT, GRIPPER):
        assert normal_force(sim, pad, "cube") == pytest.approx(GRIPPER.force, rel=0.05)


def normal_force(sim: Simulation, body: str, other: str) -> float:
    """Sum of the normal forces in newtons between two bodies."""
    total, force = 0.0, np.zeros(6)
    bodies = {sim.body_id(body), sim.body_id(other)}
    for number, geoms in enumerate(sim.data.contact.geom):
        if set(sim.model.geom_bodyid[geoms]) == bodies:
            mujoco.mj_contactForce(sim.model, sim.data, number, force)
            total += force[0]
    return total


def test_arms_that_are_driven_into_each_other_do_not_sink_in(sim: Simulation) -> None:
    deepest = 0.0
    for _ in range(90):
        flat = sim.duo.command().flat
        flat[[0, 8]] += [-1.0, 1.0]
        flat[[1, 9]] += 0.05
        sim.step(DuoCommand.from_flat(sim.duo.clipped(flat)))
        deepest = max([deepest, *(depth for *_, depth in sim.contacts.deepest(0.0))])
    assert 0.0005 < deepest < 0.005


def test_the_quaternion_of_a_tool_that_points_down_does_not_flip(sim: Simulation) -> None:
    """Seen while a tool is turned about the vertical and leans to and fro, through qw = 0."""
    kinematics = Kinematics(ROBOT)
    joints = ROBOT.home_command.joints.copy()
    seen = []
    for number in range(90):
        yaw, lean = -1.0 + 2.0 * number / 90, 0.3 * math.sin(0.1 * number)
        turn = SE3.about((0, 0, 1), yaw) @ SE3.about((1, 0, 0), math.pi)
        turn = turn @ SE3.about((1, 1, 0), lean)
        goal = SE3(turn.rotation, np.array([0.5, 0.2, 0.3]))
        joints = kinematics.step(joints, {Side.LEFT: goal})
        state = sim.step(DuoCommand(joints=joints, openings=np.ones(2)))
        seen.append(state.tcp_poses[0, 3:])
    quaternions = np.array(seen)
    assert quaternions[:, 3].min() < -0.01 < 0.01 < quaternions[:, 3].max()
    assert np.abs(np.diff(quaternions, axis=0)).max() < 0.1
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(1.0)
    assert (quaternions[:, 0] >= 0).all()


def test_arms_are_put_at_home_with_open_grippers_only(sim: Simulation) -> None:
    sim.duo.set_configuration(command(left=0.3))
    sim.forward()
    assert sim.duo.read().joints[0] == pytest.approx(HOME_JOINTS[0] + 0.3)
    with pytest.raises(ValueError, match="open grippers"):
        sim.duo.set_configuration(command(opening=0.5))


TOY = """
<mujoco>
  <worldbody>
    <body name="pendulum">
      <joint name="pivot"/><geom size="0.1"/><site name="tip"/><site/>
    </body>
  </worldbody>
  <actuator><motor name="drive" joint="pivot"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("body", ["world", "pendulum"]),
        ("joint", ["pivot"]),
        ("site", ["tip"]),  # the nameless one is not listed
        ("actuator", ["drive"]),
    ],
)
def test_names_become_ids(kind: str, names: list[str]) -> None:
    model, number = (
        mujoco.MjModel.from_xml_string(TOY),
        getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"),
    )
    assert names_of(model, number) == names
    assert [resolve(model, number, name) for name in names] == list(range(len(names)))
    with pytest.raises(UnknownNameError, match=f"{kind} '{names[-1]}x'.*mean '{names[-1]}'"):
        resolve(model, number, names[-1] + "x")
