"""The cameras in the scene, and the housings that others see."""

import mujoco

from duobench.core.spatial import SE3
from duobench.core.types import Side
from duobench.world.robot.cameras import (
    D405,
    OVERVIEW,
    ZED_MINI,
    RobotCamera,
    View,
    cameras_with,
)
from duobench.world.robot.gripper import Gripper
from duobench.world.robot.stereo import D405_BASELINE, ZED_BASELINE
from duobench.world.scene.surfaces import (
    DISTAL,
    CollisionGroup,
    add_box,
    collide_as_metal,
)

_PIXEL = 1e-5
"""Side of one pixel on the sensor in metres; only ratios matter."""
_HOUSING = (0.13, 0.13, 0.14, 1.0)
_ALUMINIUM = (0.72, 0.73, 0.75, 1.0)
_GLASS = (0.05, 0.05, 0.06, 1.0)
_LENS = (0.16, 0.18, 0.24, 1.0)


def add_cameras(
    body: mujoco.MjsBody,
    gripper: Gripper,
    arm: Side | None = None,
    body_from_mount: SE3 | None = None,
) -> None:
    """Add the cameras of an arm, or those that stand still, with their housings.

    The arm's flange, or the table frame, has a pose in the body's frame.
    """
    mount = body_from_mount or SE3()
    for camera in cameras_with(gripper).values():
        if camera.arm is not arm:
            continue
        pose = mount @ camera.pose
        height, width = camera.size
        body.add_camera(
            name=camera.name,
            pos=pose.translation,
            quat=pose.wxyz,
            resolution=(width, height),
            sensor_size=(width * _PIXEL, height * _PIXEL),
            focal_length=(camera.focal * _PIXEL, camera.focal * _PIXEL),
        )
        group = CollisionGroup.FIXTURE if arm is None else DISTAL[arm]
        for part in _HOUSINGS[camera.kind](body, camera, mount, gripper):
            collide_as_metal(part, group)


def _zed_mini(
    body: mujoco.MjsBody,
    camera: RobotCamera,
    mount: SE3,
    _gripper: Gripper,
) -> tuple[mujoco.MjsGeom, ...]:
    """Add the housing (124 x 30 x 26 mm) of a ZED Mini and its lenses; return what collides."""
    pose = mount @ camera.pose
    # The left lens is half a baseline (31.5 mm) to the left of the housing's middle.
    middle = ZED_BASELINE / 2
    housing = add_box(
        body, pose @ SE3.at(middle, 0.0, 0.014), (0.1244, 0.0304, 0.0260), _HOUSING
    )
    housing.name = f"{camera.name}/housing"
    for x in (0.0, ZED_BASELINE):
        add_box(body, pose @ SE3.at(x, 0.0, 0.001), (0.022, 0.022, 0.0012), _LENS)
    return (housing,)


def _d405(
    body: mujoco.MjsBody, camera: RobotCamera, mount: SE3, gripper: Gripper
) -> tuple[mujoco.MjsGeom, ...]:
    """Add a RealSense D405 (42 x 42 x 23 mm) and its bracket; return what collides."""
    pose = mount @ camera.pose
    housing = add_box(
        body, pose @ SE3.at(0.0, 0.0, 0.0125), (0.042, 0.042, 0.0230), _ALUMINIUM
    )
    add_box(body, pose @ SE3.at(0.0, 0.0, 0.001), (0.038, 0.030, 0.0012), _GLASS)
    for x in (-D405_BASELINE / 2, D405_BASELINE / 2):
        add_box(body, pose @ SE3.at(x, 0.0, 0.0008), (0.007, 0.007, 0.0012), _LENS)
    at = mount @ SE3.at(*gripper.bracket)
    bracket = add_box(body, at, (0.008, 0.032, 0.052), _HOUSING)
    return housing, bracket


_HOUSINGS = {ZED_MINI: _zed_mini, D405: _d405}
"""Builders of the housing of each kind of camera, in a body in which its mount has a pose."""


def add_overview_camera(world: mujoco.MjsBody, view: View) -> None:
    """Add the camera for people."""
    pose = view.pose
    world.add_camera(
        name=OVERVIEW, pos=pose.translation, quat=pose.wxyz, fovy=view.fovy_deg
    )
