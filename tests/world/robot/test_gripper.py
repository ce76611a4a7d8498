"""The description of the gripper is what the compiled model has, and one place names its kind."""

import pytest

from duobench.core.types import SIDES, Side
from duobench.real.catalog import HARDWARE_GRIPPER
from duobench.real.rig import GripperConfig
from duobench.world.robot.frames import ROBOT
from duobench.world.scene.naming import drive_names, flange_name, gripper_name, pad_names, tcp_name
from duobench.world.sim.simulation import Simulation
from tests.docs.markdown import ROOT

GRIPPER = ROBOT.gripper

KNOWS_ITS_KIND = {
    "world/robot/gripper.py",
    "world/scene/robotiq_2f85.py",
    "real/drivers/robotiq.py",
}
"""Description, builder of the model, and driver."""


@pytest.fixture(scope="module")
def sim() -> Simulation:
    return Simulation()


@pytest.mark.parametrize("side", SIDES)
def test_mass_and_tool_are_those_of_the_model(sim: Simulation, side: Side) -> None:
    base = sim.model.body(f"{gripper_name(side)}/base")
    assert sim.model.body_subtreemass[base.id] == pytest.approx(GRIPPER.mass, abs=1e-3)
    flange, tool = (sim.site_pose(name(side)) for name in (flange_name, tcp_name))
    offset = flange.inverse().apply(tool.translation)
    assert offset == pytest.approx([0.0, 0.0, GRIPPER.tool_offset])
    mounted = flange.inverse().rotation @ sim.data.xmat[base.id].reshape(3, 3)
    assert mounted == pytest.approx(GRIPPER.flange_from_base.rotation, abs=1e-6)


@pytest.mark.parametrize("side", SIDES)
def test_joints_and_actuator_close_it_as_far_as_described(sim: Simulation, side: Side) -> None:
    assert sim.model.actuator(gripper_name(side)).ctrlrange.tolist() == [
        0,
        GRIPPER.ctrl_closed,
    ]
    for name in drive_names(side, GRIPPER):
        low, high = sim.model.joint(name).range
        assert low == 0.0
        assert GRIPPER.drive_closed < high


def test_every_part_belongs_to_a_finger_or_to_the_palm(sim: Simulation) -> None:
    prefix = f"{gripper_name(Side.LEFT)}/"
    names = (sim.model.body(number).name for number in range(sim.model.nbody))
    parts = [name.removeprefix(prefix) for name in names if name.startswith(prefix)]
    assert [part for part in parts if GRIPPER.finger_of(part) is None] == ["base"]
    assert {f"{prefix}{part}" for part in parts} > set(pad_names(Side.LEFT, GRIPPER))
    assert {GRIPPER.finger_of(part) for part in GRIPPER.pads} == set(GRIPPER.fingers)


def test_a_rig_has_its_driver_speeds_and_forces() -> None:
    assert GripperConfig().driver == HARDWARE_GRIPPER
    slow, fast = (GripperConfig(speed=byte, force=byte) for byte in (0, 255))
    assert (
        slow.mm_per_s(GRIPPER) / 1000,
        fast.mm_per_s(GRIPPER) / 1000,
    ) == pytest.approx(GRIPPER.speeds)
    assert (slow.newtons(GRIPPER), fast.newtons(GRIPPER)) == pytest.approx(GRIPPER.forces)


def test_no_other_module_names_its_kind() -> None:
    package = ROOT / "src" / "duobench"
    word = GRIPPER.word
    naming = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if word in path.read_text(encoding="utf-8").lower()
    }
    assert naming == KNOWS_ITS_KIND
