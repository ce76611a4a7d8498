"""The cameras: where they sit, what they see, and the housings that others see.

A camera is given by its intrinsics, so an image of any size shows the whole native field of view:
it equals the native 1280x720 image resized to that size.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from duobench.robot.cameras import NATIVE_HEIGHT, NATIVE_WIDTH, OVERVIEW, View, looking
from duobench.scene.filters import Group, distal
from duobench.scene.surfaces import add_box, collide_as_metal
from duobench.spatial import SE3
from duobench.types import HEAD, Side, wrist_name

HEAD_POSITION = (0.0113, 0.001, 0.695)
"""Left lens of the ZED Mini in the table frame, in metres [manufacturer's camera holder]."""
HEAD_PITCH = math.radians(41.0)
"""How far the head camera looks down."""
HEAD_FOCAL = 740.0
"""Focal length of the head camera in native pixels; 51.9 degrees vertically."""
WRIST_POSITION = (0.050, 0.0, 0.067)
"""Wrist camera in the flange frame, in metres [manufacturer's camera mount]."""
WRIST_TILT = math.radians(20.0)
"""How far a wrist camera is tilted from the flange's z towards the fingertips."""
WRIST_FOCAL = 650.0
"""Focal length of a wrist camera in native pixels; 58 degrees vertically."""
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
    direction = np.array([math.cos(HEAD_PITCH), 0.0, -math.sin(HEAD_PITCH)])
    pose = looking(np.array(HEAD_POSITION), direction, np.array([0.0, 0.0, 1.0]))
    _add_camera(world, HEAD, pose, HEAD_FOCAL)
    # The left lens is half a baseline (31.5 mm) to the left of the housing's middle.
    middle = ZED_BASELINE / 2
    housing = add_box(world, pose @ SE3.at(middle, 0.0, 0.014), (0.1244, 0.0304, 0.0260), _HOUSING)
    housing.name = f"{HEAD}/housing"
    collide_as_metal(housing, Group.FIXTURE)
    for x in (0.0, ZED_BASELINE):
        add_box(world, pose @ SE3.at(x, 0.0, 0.001), (0.022, 0.022, 0.0012), _LENS)


def add_wrist_camera(flange: mujoco.MjsBody, flange_from_body: SE3, side: Side) -> None:
    """Add a RealSense D405 (42 x 42 x 23 mm) in front of the gripper, its bracket and its camera.

    Args:
        flange: Body that carries the flange.
        flange_from_body: Pose of the flange in that body.
        side: Whose wrist it is.
    """
    direction = np.array([-math.sin(WRIST_TILT), 0.0, math.cos(WRIST_TILT)])
    pose = flange_from_body @ looking(
        np.array(WRIST_POSITION), direction, np.array([1.0, 0.0, 0.0])
    )
    _add_camera(flange, wrist_name(side), pose, WRIST_FOCAL)
    housing = add_box(flange, pose @ SE3.at(0.0, 0.0, 0.0125), (0.042, 0.042, 0.0230), _ALUMINIUM)
    add_box(flange, pose @ SE3.at(0.0, 0.0, 0.001), (0.038, 0.030, 0.0012), _GLASS)
    for x in (-D405_BASELINE / 2, D405_BASELINE / 2):
        add_box(flange, pose @ SE3.at(x, 0.0, 0.0008), (0.007, 0.007, 0.0012), _LENS)
    at = flange_from_body @ SE3.at(0.046, 0.0, 0.020)
    bracket = add_box(flange, at, (0.008, 0.032, 0.052), _HOUSING)
    for part in (housing, bracket):
        collide_as_metal(part, distal(side))


def add_overview_camera(world: mujoco.MjsBody, view: View) -> None:
    """Add the camera for people."""
    pose = view.pose
    world.add_camera(name=OVERVIEW, pos=pose.translation, quat=pose.wxyz, fovy=view.fovy_deg)
