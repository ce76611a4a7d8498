"""A rig's file lets no mistake pass: each is refused in a sentence that names its key."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import FileError, ImportPathError, OptionError, UnknownNameError
from duobench.real.opening import open_rig
from duobench.real.rig import JOINT_TORQUES, ArmConfig, Rig
from duobench.world.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH
from tests.real.simulated import (
    ARM,
    CAMERA,
    GRIPPER,
    SimulatedArm,
    SimulatedCamera,
    simulated_file,
)

LENS: dict[str, Any] = {
    **{"fx": 700.0, "fy": 700.0, "cx": 640.0, "cy": 360.0},
    "pose": [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
}
RIGHT: dict[str, Any] = {
    "name": "lab 1",
    "arms": {"left": {"address": "172.16.0.2"}, "right": {"address": "172.16.1.2"}},
    "grippers": {"left": {"port": "/dev/left"}, "right": {"port": "/dev/right"}},
    "cameras": {
        "head": {"driver": "uvc", "device": "/dev/zed", "calibration": LENS},
        "left_wrist": {"driver": "realsense", "device": "1"},
        "right_wrist": {"driver": "realsense", "device": "2"},
    },
    "workspace": {"low": [0.1, -0.5, 0.0]},
    "obstacles": {"mast": {"centre": [0.0, 0.9, 0.5], "size": [0.1, 0.1, 1.0]}},
    "schema": 2,
}
"""A file that is right."""
BESIDE = "damping of joint 1 is 24.5 to 73.5 beside its stiffness of 600"

Row = tuple[str, Any, str]
REVIEWED: tuple[Row, ...] = (
    ("arms.left.speed_fracton", 0.05, "key of arms.left 'speed_fracton'. Did you mean 'speed_fra"),
    ("arms.left.torque_treshold", 5, "'torque_treshold'. Did you mean 'torque_threshold'"),
    ("cams", {}, "key of the file 'cams'. Did you mean 'arms' or 'cameras'"),
    ("arms.right.address", "172.16.0.2", "arms.right.address is '172.16.0.2' as for arms.left"),
    ("arms.left.address", "", "arms.left.address says where it is"),
    ("grippers.right.port", "/dev/left", "grippers.right.port is '/dev/left' as for grippers.left"),
    ("cameras.right_wrist.device", "1", "right_wrist.device is '1' as for cameras.left_wrist"),
    ("cameras.head.size", [1280, 720], "cameras.head: size is height and width in pixels"),
    ("cameras.head.fps", 0, "cameras.head: fps is 5 to 120, got 0"),
    ("cameras.head.calibration.fx", -700.0, "fx and fy are 256 to 25600 pixels"),
    ("cameras.head.calibration.pose", [0.0] * 7, "qx qy qz qw, has length 1; got [0.0, 0.0"),
    ("arms.left.stiffness", [60000.0] * 7, "stiffness of joint 1 is over 0 and at most 1200"),
    ("arms.left.damping", [0.001] * 7, f"{BESIDE}, got 0.001"),
    ("arms.left.torque_threshold", [100.0] * 7, "torque_threshold of joint 1 is over 0 and at mos"),
    ("arms.left.torque_threshold", [20.0] * 7, "torque_threshold of joint 5 is over 0 and at most"),
    ("cameras.head", {"driver": "rehearsal"}, "cameras.head.driver is rehearsal beside a real arm"),
)
"""What was once accepted without a word."""
OWN: tuple[Row, ...] = (
    ("arms.lef", {}, "Unknown key of arms 'lef'. Did you mean 'left'"),
    ("grippers.left.forse", 9, "Unknown key of grippers.left 'forse'. Did you mean 'force'"),
    ("cameras.heed", {"driver": "uvc"}, "Unknown camera of a rig 'heed'. Did you mean 'head'"),
    ("cameras.head.calibration.fxx", 1.0, "key of cameras.head.calibration 'fxx'. Did you mean"),
    ("workspace.hi", [1.0, 1.0, 1.0], "Unknown key of workspace 'hi'. Did you mean 'high'"),
    ("obstacles.mast.center", [1.0, 1.0, 1.0], "obstacles.mast 'center'. Did you mean 'centre'"),
    ("arms.left.driver", "frankly", "Unknown arms.left.driver 'frankly'. Did you mean 'franky'"),
    ("cameras.head.driver", "kinect", "Known: file, module:NAME, realsense, rehearsal, uvc"),
    ("cameras.head.depth", True, "cameras.head.depth: the driver uvc gives colour alone"),
    ("arms.left.driver", 3, "arms.left.driver: Expected `str`, got `int`"),
    ("arms.left.torque_threshold", 20.0, "arms.left.torque_threshold: Expected `array`, got"),
    ("arms.left.torque_threshold", [5.0] * 6, "torque_threshold is 7 numbers, one a joint"),
    ("arms.left.moment_threshold", 30.0, "moment_threshold is over 0 and at most 12, got 30"),
    ("arms.left.tool_speed", 3.0, "tool_speed is over 0 and at most 2, got 3"),
    ("arms.left.stiffness", [3000.0, *[100.0] * 6], "stiffness of joint 1 is over 0 and at most"),
    ("arms.left.damping", [500.0] * 7, f"{BESIDE}, got 500"),
    ("arms.left.address", "172.16.0.256", "arms.left.address is a host name or four numbers"),
    ("arms.left.address", "http://172.16.0.2", "arms.left.address is a host name or four numbers"),
    ("arms.left.address", " 172.16.0.2", "arms.left.address says where it is, without spaces"),
    ("arms.left.speed_fraction", "0.1", "arms.left.speed_fraction: Expected `float`, got `str`"),
    ("arms.left.is_realtime", 1, "arms.left.is_realtime: Expected `bool`, got `int`"),
    ("arms.right.driver", "rehearsal", "arms.right.driver is rehearsal beside a real arm"),
    ("grippers.left.driver", "rehearsal", "left.driver is rehearsal beside a real arm"),
    ("grippers.left.port", "", "grippers.left.port says where it is"),
    ("grippers.left.port", "/dev/zed", "cameras.head.device is '/dev/zed' as for grippers.left"),
    ("grippers.left.closed_count", 40, "closed_count is larger than open_count by 150 at least"),
    ("grippers.left.force", 300, "grippers.left: force is 0 to 255, got 300"),
    ("cameras.left_wrist.device", "", "cameras.left_wrist.device says where it is"),
    ("cameras.left_wrist.driver", "file", "left_wrist.driver is file beside a real arm"),
    ("cameras.head.exposure_us", 1e6, "exposure_us is over 0 and at most 33333"),
    ("cameras.head.gain", -1.0, "cameras.head: gain is 0 or more, got -1"),
    ("cameras.head.calibration.cx", 1280.0, "cx and cy lie in the image of 1280 x 720 pixels"),
    ("cameras.head.calibration.pose", [0.0] * 6, "A pose has 7 numbers"),
    ("workspace.high", [0.4, 0.5, 1.0], "workspace: low and high of a workspace have both tools"),
    ("workspace.low", [0.5, 0.5], "workspace.low: Expected `array` of length 3"),
    ("obstacles.mast.size", [0.1, 0.0, 1.0], "obstacles.mast: size is three lengths over 0"),
    ("obstacles", [], "obstacles is an object, with keys in braces"),
    ("name", " ", "have names in one line, got ' '"),
    ("obstacles", {"a\nb": RIGHT["obstacles"]["mast"]}, r"have names in one line, got 'a\nb'"),
    ("obstacles.mast.yaw", 30.0, "obstacles.mast: yaw is an angle in radians"),
    ("obstacles.mast.centre", [500.0, 0.0, 0.0], "centre is at most 5 m away along each axis"),
    ("cameras.head.calibration.pose", [0.0, 0.0, 900.0, 0.0, 0.0, 0.0, 1.0], "are in metres, at"),
    ("cameras.head.calibration.fy", 0.7, "fx and fy are 256 to 25600 pixels"),
    ("cameras.left_wrist.driver", "rehearsal", "left_wrist.driver is rehearsal beside a real arm"),
    ("schema", 1, "schema is 2, got 1. Since schema 2 torque_threshold is 7 numbers"),
)


def changed(place: str, value: Any) -> dict[str, Any]:
    """The file that is right, but for one value."""
    document = deepcopy(RIGHT)
    *way, key = place.split(".")
    inner = document
    for each in way:
        inner = inner[each]
    inner[key] = value
    return document


def read(folder: Path, text: str) -> Rig:
    path = folder / "rig.json"
    path.write_text(text)
    return Rig.read(path)


def test_what_is_right_is_read_and_written_as_it_is(tmp_path: Path) -> None:
    rig = read(tmp_path, json.dumps(RIGHT))
    rig.write(tmp_path / "again.json")
    again = Rig.read(tmp_path / "again.json")
    assert (again, again.hash) == (rig, rig.hash)
    assert (rig.cameras["head"].size, len(rig.obstacles)) == ((NATIVE_HEIGHT, NATIVE_WIDTH), 1)


@pytest.mark.parametrize(("place", "value", "said"), [*REVIEWED, *OWN])
def test_a_wrong_file_is_refused_with_its_key(
    tmp_path: Path, place: str, value: Any, said: str
) -> None:
    with pytest.raises(FileError) as refused:
        read(tmp_path, json.dumps(changed(place, value)))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"name": "x", "name": "y"}', "'name' stands twice"),
        ('{"arms": {"left": {"speed_fraction": 0.1, "speed_fraction": 0.5}}}', "stands twice"),
        ('{"name": NaN}', "Numbers are finite, got NaN"),
        ('{"name": 1e999}', "Numbers are finite, got 1e999"),
        ("[]", "the file is an object"),
        ("", "Cannot read a rig"),
        ('{"name": "x",}', "Cannot read a rig"),
        ("[" * 100_000, "Cannot read a rig"),
        ('{"name": "x", "arms": {"left": 3}}', "arms.left is an object"),
        ("{}", "missing required field `name`"),
    ],
)
def test_what_is_no_file_of_a_rig_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(FileError, match=r"Cannot read a rig from .*rig\.json") as refused:
        read(tmp_path, text)
    assert said in str(refused.value)


def objects(document: Any) -> Iterator[dict[str, Any]]:
    """Every object in a file, itself included."""
    if isinstance(document, dict):
        yield document
        for each in [*document.values()]:
            yield from objects(each)


def test_an_unknown_key_is_refused_at_every_depth(tmp_path: Path) -> None:
    document = deepcopy(RIGHT)
    places = [each for each in objects(document) if each is not document["obstacles"]]
    assert len(places) >= 14
    for each in places:
        each["strange"] = {"driver": "file"}
        with pytest.raises(FileError, match=r"Unknown .* 'strange'"):
            read(tmp_path, json.dumps(document))
        del each["strange"]
    read(tmp_path, json.dumps(document))


def test_nothing_is_computed_that_a_file_does_not_name(tmp_path: Path) -> None:
    without: Mapping[str, Any] = {key: RIGHT[key] for key in RIGHT if key != "cameras"}
    assert dict(read(tmp_path, json.dumps(without)).cameras) == {}


def test_beside_simulators_of_arms_the_rest_may_be_computed(tmp_path: Path) -> None:
    document = changed("cameras", {"head": {"driver": CAMERA}})
    document["arms"] = {
        side: {"address": f"127.0.0.{number}"} for number, side in enumerate(("left", "right"), 1)
    }
    rig = read(tmp_path, json.dumps(document))
    assert isinstance(open_rig(rig).cameras["head"], SimulatedCamera)


def test_a_name_that_looks_as_an_address_of_this_computer_is_no_simulators(tmp_path: Path) -> None:
    document = changed("cameras", {"head": {"driver": "file"}})
    document["arms"] = {"left": {"address": "127.lab"}, "right": {"address": "127.0.0.2"}}
    with pytest.raises(FileError, match=r"head\.driver is file beside a real arm"):
        read(tmp_path, json.dumps(document))


def test_a_threshold_stops_an_arm_before_its_joints_give_all_they_can() -> None:
    thresholds = ArmConfig().torque_threshold
    assert all(low <= most / 1.5 for low, most in zip(thresholds, JOINT_TORQUES, strict=True))
    assert JOINT_TORQUES == (87, 87, 87, 87, 12, 12, 12)


def own(folder: Path, part: str, driver: str) -> Rig:
    """A simulated rig of which one part's left or only device has another driver, from its file."""
    name = "left" if part != "cameras" else "head"
    document = json.loads(simulated_file(folder).read_text())
    document[part][name]["driver"] = driver
    return read(folder, json.dumps(document))


HERE = __name__


class Talker:
    """What is no arm, gripper or camera."""

    is_computed = True

    def __init__(self, *_: Any) -> None:
        self.connect = self.close = lambda: None


class LabArm(SimulatedArm):
    """An arm that is said to be real."""

    is_computed = False


class Broken:
    """What cannot be made."""

    is_computed = True

    def __init__(self, *_: Any) -> None:
        raise ValueError("no such cable")


@pytest.mark.parametrize("part", ["arms", "grippers", "cameras"])
@pytest.mark.parametrize(
    ("driver", "said"),
    [
        ("no_such_lab:Device", "There is no module named 'no_such_lab'. Install it, or put"),
        (":Device", "':Device' is no `module:attribute`"),
        ("my_lab.py:Device", "the module is found by its name: my_lab:Device"),
        (f"{HERE}:Talkr", "Did you mean 'Talker'"),
        (f"{HERE}:LENS", "whose LENS is of type dict"),
        (f"{HERE}:Talker", "makes something without"),
        (f"{HERE}:Broken", "no such cable"),
    ],
)
def test_driver_of_ones_own_that_is_none_is_told(
    tmp_path: Path, part: str, driver: str, said: str
) -> None:
    rig = own(tmp_path, part, driver)
    with pytest.raises((ImportPathError, UnknownNameError)) as refused:
        open_rig(rig)
    assert said in str(refused.value)


def test_file_names_a_driver_without_importing_it(tmp_path: Path) -> None:
    rig = own(tmp_path, "arms", "no_such_lab:Arm")
    assert "no_such_lab:Arm" in rig.drivers


@pytest.mark.parametrize("part", ["arms", "grippers"])
def test_what_is_computed_beside_a_real_arm_of_ones_own_is_refused(
    tmp_path: Path, part: str
) -> None:
    rig = own(tmp_path, "arms", f"{HERE}:LabArm")
    assert not rig.is_computed
    with pytest.raises(OptionError, match=r"arms\.right\.driver is tests.* beside a real arm"):
        open_rig(rig)
    document = changed(f"{part}.left.driver", ARM if part == "arms" else GRIPPER)
    with pytest.raises(OptionError, match=rf"{part}\.left\.driver is tests.* beside a real arm"):
        open_rig(read(tmp_path, json.dumps(document)))


def test_devices_of_ones_own_have_places_of_their_own(tmp_path: Path) -> None:
    document = changed("arms.left.driver", "my_lab:Arm")
    document["arms"]["left"]["address"] = "can0 bus 1"
    read(tmp_path, json.dumps(document))
    document["arms"]["left"]["address"] = "172.16.1.2"
    with pytest.raises(FileError, match=r"arms\.right\.address is '172\.16\.1\.2' as for arms\.le"):
        read(tmp_path, json.dumps(document))
