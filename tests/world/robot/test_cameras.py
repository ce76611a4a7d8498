"""Cameras are described once: the model, what policies are offered and commands have the same."""

import json
import math
import re
from dataclasses import asdict, replace
from inspect import signature
from typing import Any

import msgspec
import numpy as np
import pytest

from duobench.cli.real.calibrate import lens
from duobench.core.errors import OptionError, UnknownNameError
from duobench.core.settings import decode
from duobench.core.types import SIDES
from duobench.envs import EnvConfig
from duobench.real.canonical import focal_of, nominal_pose
from duobench.real.opening import rehearsal_rig
from duobench.world.robot.cameras import (
    CAMERAS,
    MUJOCO_FROM_OPENCV,
    OVERVIEW,
    POLICY_CAMERAS,
    Camera,
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


PLACED: dict[str, Any] = {"name": "side", "position": (0.5, 1.2, 0.6), "look_at": (0.5, 0, 0)}


@pytest.mark.parametrize(
    ("changed", "error", "words"),
    [
        *(({"name": name}, OptionError, "lower-case letter") for name in ("", "Side", "a/b", 3)),
        *(({"name": name}, OptionError, "lower-case letter") for name in ("_a", "1a", "é", "a\n")),
        *(({"name": name}, OptionError, f"'my_{name}'") for name in (*CAMERAS, OVERVIEW)),
        *(
            ({"position": place}, OptionError, "position of camera 'side' is three finite numbers")
            for place in ((0, 0), "abc", 3, None, (0, 0, math.nan), (0, 0, True), (0, 0, "1"))
        ),
        ({"look_at": (0, math.inf, 0)}, OptionError, "look_at of camera 'side' is three finite"),
        ({"look_at": (0, 1000, 0)}, OptionError, "in metres, at most 100 either way"),
        ({"look_at": (0.5, 1.2, 0.6)}, OptionError, "looks at its own position"),
        ({"look_at": (0.5, 1.2, 0.6 + 1e-9)}, OptionError, "looks at its own position"),
        ({"position": (4, 0, 0)}, OptionError, "inside the room, at x -1.60 to 3.00"),
        ({"position": (0, 0, -1)}, OptionError, "inside the room"),
        ({"on": "left_flange", "position": (0, 0, 3)}, OptionError, "near the left_flange"),
        ({"on": "left_wrist"}, UnknownNameError, "'left_wrist'.*left_flange, right_flange, table"),
        ({"on": None}, UnknownNameError, "frame of camera 'side'"),
        *(
            ({"fovy_deg": angle}, OptionError, "fovy_deg of camera 'side' is 1 to 150 degrees")
            for angle in (0, 151, math.nan, "60", None, True)
        ),
        *(
            ({"size": size}, OptionError, "size of camera 'side'.*720, 1280")
            for size in ((721, 10), (10, 1281), 0, (1, 2, 3), 1.5, "a")
        ),
    ],
    ids=str,
)
def test_a_camera_that_cannot_be_is_refused(
    changed: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        Camera(**{**PLACED, **changed})


def test_a_camera_is_plain_data_both_ways() -> None:
    camera = Camera(
        name="side", position=np.array([1, 0, 1]), look_at=[0, 0, 0], size=np.int64(64), fovy_deg=40
    )
    assert camera == Camera(
        name="side", position=(1, 0, 1), look_at=(0.0, 0, 0), size=(64, 64), fovy_deg=40.0
    )
    assert hash(camera) == hash(replace(camera))
    for text in (msgspec.json.encode(camera), json.dumps(asdict(camera))):
        assert msgspec.json.decode(text, type=Camera) == camera
    assert decode(asdict(camera), Camera) == camera
    with pytest.raises(OptionError, match="fovy_deg of camera 'side' is 1 to 150"):
        decode({**asdict(camera), "fovy_deg": 0.0}, Camera)


@pytest.mark.parametrize(
    ("on", "look_at", "up"),
    [
        ("table", (0.5, 0.0, 0.0), None),
        ("table", (0.5, 1.2, 0.0), (1.0, 0.0, 0.0)),
        ("left_flange", (0.5, 1.2, 0.9), (1.0, 0.0, 0.0)),
        ("left_flange", (0.7, 1.2, 0.6), (0.0, 0.0, 1.0)),
    ],
)
def test_a_camera_looks_where_it_is_said_and_stands_upright(
    on: str, look_at: tuple[float, float, float], up: tuple[float, float, float] | None
) -> None:
    pose = Camera(**{**PLACED, "look_at": look_at, "on": on}).pose
    ahead = np.array(look_at) - PLACED["position"]
    assert -pose.rotation[:, 2] == pytest.approx(ahead / np.linalg.norm(ahead))
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
    if up is None:
        assert pose.rotation[2, 1] > 0.0
        assert pose.rotation[2, 0] == pytest.approx(0.0)
    else:
        assert pose.rotation[:, 1] == pytest.approx(up)
