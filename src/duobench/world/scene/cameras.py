"""The cameras in the scene, and the housings that others see."""

import mujoco

from duobench.core.spatial import SE3
from duobench.core.types import HEAD, Side, wrist_name
from duobench.world.robot.cameras import (
    FLANGE_FROM_WRIST,
    HEAD_FOCAL,
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
    OVERVIEW,
    TABLE_FROM_HEAD,
    WRIST_FOCAL,
    View,
)
from duobench.world.scene.surfaces import DISTAL, CollisionGroup, add_box, collide_as_metal

ZED_BASELINE, D405_BASELINE = 0.063, 0.018
"""Distance between the two lenses of a camera in metres [data sheets]."""

_PIXEL = 1e-5
"""Side of one pixel on the sensor in metres; only ratios matter."""
_HOUSING = (0.13, 0.13, 0.14, 1.0)
_ALUMINIUM = (0.72, 0.73, 0.75, 1.0)
_GLASS = (0.05, 0.05, 0.06, 1.0)
_LENS = (0.16, 0.18, 0.24, 1.0)


def _add_camera(body: mujoco.MjsBody, name: str, pose: SE3, focal: float) -> None:
    body.add_camera(
        name=name,
        pos=pose.translation,
        quat=pose.wxyz,
        resolution=(NATIVE_WIDTH, NATIVE_HEIGHT),
        sensor_size=(NATIVE_WIDTH * _PIXEL, NATIVE_HEIGHT * _PIXEL),
        focal_length=(focal * _PIXEL, focal * _PIXEL),
    )


def add_head_camera(world: mujoco.MjsBody) -> None:
    """Add the ZED Mini above the mount: housing (124 x 30 x 26 mm), lenses, and the camera."""
    pose = TABLE_FROM_HEAD
    _add_camera(world, HEAD, pose, HEAD_FOCAL)
    # The left lens is half a baseline (31.5 mm) to the left of the housing's middle.
    middle = ZED_BASELINE / 2
    housing = add_box(world, pose @ SE3.at(middle, 0.0, 0.014), (0.1244, 0.0304, 0.0260), _HOUSING)
    housing.name = f"{HEAD}/housing"
    collide_as_metal(housing, CollisionGroup.FIXTURE)
    for x in (0.0, ZED_BASELINE):
        add_box(world, pose @ SE3.at(x, 0.0, 0.001), (0.022, 0.022, 0.0012), _LENS)


def add_wrist_camera(flange: mujoco.MjsBody, flange_from_body: SE3, side: Side) -> None:
    """Add a RealSense D405 (42 x 42 x 23 mm) in front of the gripper, its bracket and camera."""
    pose = flange_from_body @ FLANGE_FROM_WRIST
    _add_camera(flange, wrist_name(side), pose, WRIST_FOCAL)
    housing = add_box(flange, pose @ SE3.at(0.0, 0.0, 0.0125), (0.042, 0.042, 0.0230), _ALUMINIUM)
    add_box(flange, pose @ SE3.at(0.0, 0.0, 0.001), (0.038, 0.030, 0.0012), _GLASS)
    for x in (-D405_BASELINE / 2, D405_BASELINE / 2):
        add_box(flange, pose @ SE3.at(x, 0.0, 0.0008), (0.007, 0.007, 0.0012), _LENS)
    at = flange_from_body @ SE3.at(0.046, 0.0, 0.020)
    bracket = add_box(flange, at, (0.008, 0.032, 0.052), _HOUSING)
    for part in (housing, bracket):
        collide_as_metal(part, DISTAL[side])


def add_overview_camera(world: mujoco.MjsBody, view: View) -> None:
    """Add the camera for people."""
    pose = view.pose
    world.add_camera(name=OVERVIEW, pos=pose.translation, quat=pose.wxyz, fovy=view.fovy_deg)
