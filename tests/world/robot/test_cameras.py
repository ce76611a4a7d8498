"""Cameras are described once: the model, what policies are offered and commands have the same."""

import re
from inspect import signature

import pytest

from duobench.cli.real.calibrate import lens
from duobench.core.types import SIDES
from duobench.envs import EnvConfig
from duobench.real.canonical import focal_of, nominal_pose
from duobench.real.opening import rehearsal_rig
from duobench.world.robot.cameras import (
    CAMERAS,
    MUJOCO_FROM_OPENCV,
    OVERVIEW,
    POLICY_CAMERAS,
    RobotCamera,
    describe_cameras,
)
from duobench.world.scene.naming import flange_name
from duobench.world.sim.simulation import Simulation
from tests.docs.markdown import ROOT

NAMES_CAMERAS = {
    "cli/real/calibrate/lens.py",
    "world/looks/catalog.py",
    "world/robot/cameras.py",
}
"""Beside the descriptions, words of commands, and by how much a look moves each camera."""


@pytest.fixture(scope="module")
def sim() -> Simulation:
    return Simulation()


def test_the_model_has_the_described_cameras_and_that_for_people(sim: Simulation) -> None:
    names = {sim.model.camera(number).name for number in range(sim.model.ncam)}
    assert names == {*CAMERAS, OVERVIEW}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_lens_and_place_are_those_of_the_model(sim: Simulation, camera: RobotCamera) -> None:
    made = sim.model.camera(camera.name)
    height, width = camera.size
    assert sim.model.cam_resolution[made.id].tolist() == [width, height]
    focal, _, *_ = sim.model.cam_intrinsic[made.id] / sim.model.cam_sensorsize[made.id, 0] * width
    assert focal == pytest.approx(camera.focal)
    position = sim.data.cam_xpos[made.id]
    if camera.arm is not None:
        position = sim.site_pose(flange_name(camera.arm)).inverse().apply(position)
    assert position == pytest.approx(camera.pose.translation, abs=1e-6)
    body = sim.model.body(int(sim.model.cam_bodyid[made.id])).name
    moves_with = [side for side in SIDES if body.startswith(f"{side}/")]
    assert moves_with == ([] if camera.arm is None else [camera.arm])


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_real_images_are_made_like_the_described_ones(camera: RobotCamera) -> None:
    assert focal_of(camera.name) == camera.focal
    expected = (camera.pose @ MUJOCO_FROM_OPENCV).tquat
    assert nominal_pose(camera.name).tquat == pytest.approx(expected)
    assert describe_cameras()[camera.name]["intrinsics"][0][0] == camera.focal


def test_which_cameras_there_are_is_said_once() -> None:
    assert tuple(CAMERAS) == POLICY_CAMERAS == EnvConfig().cameras
    assert tuple(rehearsal_rig().cameras) == POLICY_CAMERAS
    words = signature(lens.run, eval_str=True).parameters["camera"].annotation
    assert repr(POLICY_CAMERAS)[1:-1] in repr(words)
    package = ROOT / "src" / "duobench"
    quoted = re.compile(rf"""["']({"|".join(CAMERAS)})["'](?!\])""")
    naming = {
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if quoted.search(path.read_text(encoding="utf-8"))
    }
    assert naming <= NAMES_CAMERAS
