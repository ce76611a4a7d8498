"""The cameras, each described once: name, lens, where it is mounted; and the view for people.

The scene builds them by these descriptions, policies and data are offered them by name, and real
images are made like theirs. Another camera is another row of `CAMERAS`, and its housing in
`scene.cameras`.

A camera is given by its intrinsics, so an image of any size shows the whole native field of view:
it equals the native 1280x720 image resized to that size.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from duobench.core.errors import RenderingError
from duobench.core.spatial import SE3, length
from duobench.core.types import SIDES, Side
from duobench.world.robot.gripper import GRIPPER

NATIVE_HEIGHT, NATIVE_WIDTH = 720, 1280
"""Native image size of the cameras in pixels."""
HEAD = "head"
"""The camera above the robot's shoulders."""
ZED_MINI, D405 = "Stereolabs ZED Mini", "Intel RealSense D405"
"""Kinds of cameras."""
HEAD_POSITION = (0.0113, 0.001, 0.695)
"""Left lens of the ZED Mini in the table frame, in metres [manufacturer's camera holder]."""
HEAD_PITCH = math.radians(41.0)
"""Angle of the head camera below the horizontal."""
WRIST_POSITION = (0.050, 0.0, 0.067)
"""Wrist camera in the flange frame, in metres [manufacturer's camera mount]."""
WRIST_TILT = math.radians(20.0)
"""Tilt of a wrist camera from the flange's z towards the fingertips."""
OVERVIEW = "overview"
"""A view of the whole scene for people; not part of any observation."""


def check_image_size(height: int, width: int) -> None:
    """Check that a camera can give images of a size, in pixels."""
    if not (0 < height <= NATIVE_HEIGHT and 0 < width <= NATIVE_WIDTH):
        raise RenderingError(
            f"An image of {width}x{height} cannot be rendered: the cameras have "
            f"{NATIVE_WIDTH}x{NATIVE_HEIGHT} pixels, so width must be 1 to {NATIVE_WIDTH} "
            f"and height 1 to {NATIVE_HEIGHT}."
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """A camera for people."""

    eye: tuple[float, float, float]
    """Position of the camera in the table frame, in metres."""
    target: tuple[float, float, float]
    """Point in the middle of the image, in the table frame, in metres."""
    fovy_deg: float
    """Vertical field of view in degrees."""

    @property
    def pose(self) -> SE3:
        """Pose of the camera in the table frame, upright."""
        eye = np.array(self.eye)
        return looking(eye, np.array(self.target) - eye, np.array([0.0, 0.0, 1.0]))


OVERVIEW_VIEW = View(eye=(2.35, -1.35, 1.42), target=(0.34, -0.03, 0.17), fovy_deg=37.0)
"""Robot and table from beyond the far edge; for a task that turns its back on it, see
`Task.overview`."""


def looking(
    eye: np.ndarray,
    direction: np.ndarray,
    up: np.ndarray,
) -> SE3:
    """Pose of a MuJoCo camera (x right, y up, looking along -z) in the frame of the arguments.

    The direction (3,) has any length; `up` (3,) is what shall point upwards in the image.
    """
    back = -direction / length(direction)
    right = np.cross(up, back)
    right /= length(right)
    return SE3(np.column_stack([right, np.cross(back, right), back]), eye)


def wrist_name(side: Side) -> str:
    """Name of the camera on an arm's wrist."""
    return f"{side}_wrist"


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Camera:
    """A camera of the robot, without distortion."""

    name: str
    kind: str
    """The camera that it stands for, by which the scene builds its housing."""
    arm: Side | None
    """The arm that it moves with, on whose flange it is; None for one that stands still."""
    pose: SE3
    """Pose in the frame of that flange, or of the table, with MuJoCo's axes."""
    focal: float
    """Focal length in native pixels."""
    size: tuple[int, int] = (NATIVE_HEIGHT, NATIVE_WIDTH)
    """Height and width of its native images in pixels."""


_HEAD = Camera(
    name=HEAD,
    kind=ZED_MINI,
    arm=None,
    pose=looking(
        np.array(HEAD_POSITION),
        np.array([math.cos(HEAD_PITCH), 0.0, -math.sin(HEAD_PITCH)]),
        np.array([0.0, 0.0, 1.0]),
    ),
    focal=740.0,  # 51.9 degrees vertically
)


def _wrist(side: Side) -> Camera:
    """Describe the camera on an arm's wrist, which is the same on both arms."""
    return Camera(
        name=wrist_name(side),
        kind=D405,
        arm=side,
        pose=looking(
            np.array(WRIST_POSITION),
            np.array([-math.sin(WRIST_TILT), 0.0, math.cos(WRIST_TILT)]),
            np.array([1.0, 0.0, 0.0]),
        ),
        focal=650.0,  # 58 degrees vertically
    )


CAMERAS: Mapping[str, Camera] = {
    camera.name: camera for camera in (_HEAD, *map(_wrist, SIDES))
}
"""The cameras of the robot by their names."""
POLICY_CAMERAS = tuple(CAMERAS)
"""The cameras that a policy may see, and sees if nothing else is said."""
MUJOCO_FROM_OPENCV = SE3(np.diag([1.0, -1.0, -1.0]))
"""A camera with OpenCV's axes (x right, y down, z forwards) in one with MuJoCo's."""


def describe_cameras() -> dict[str, dict[str, Any]]:
    """Lenses and mounts of the policy's cameras, as plain JSON data in OpenCV's convention.

    They are nominal: a look may move a camera or change its field of view (`Look.cameras`), and
    says by how much.

    Returns:
        By the name of the camera:

        - `size`: native height and width of an image in pixels.
        - `intrinsics`: matrix K (3, 3), row by row, in native pixels. The middle of the top left
          pixel is (0, 0); there is no distortion. In an image of height h and width w, scaled from
          720x1280, focal lengths and (centre + 0.5) are multiplied by w / 1280 across and by
          h / 720 down.
        - `frame`: what the camera is mounted on: "table", or "left_tool" or "right_tool", the
          frames whose poses in the table frame are `tcp_pose`.
        - `frame_from_camera`: pose of the camera in that frame, a matrix (4, 4) row by row, in
          metres. The camera's x points right in the image, y down, and z into the scene.

    Example:
        >>> describe_cameras()["head"]["frame"]
        'table'
    """
    return {name: _describe(camera) for name, camera in CAMERAS.items()}


def _describe(camera: Camera) -> dict[str, Any]:
    height, width = camera.size
    middle = (width - 1) / 2, (height - 1) / 2
    frame, pose = "table", camera.pose
    if camera.arm is not None:
        frame = f"{camera.arm}_tool"
        pose = SE3.at(z=-GRIPPER.tool_offset) @ pose
    frame_from_camera = pose @ MUJOCO_FROM_OPENCV
    matrix = np.eye(4)
    matrix[:3, :3] = frame_from_camera.rotation
    matrix[:3, 3] = frame_from_camera.translation
    return {
        "size": [height, width],
        "intrinsics": [
            [camera.focal, 0.0, middle[0]],
            [0.0, camera.focal, middle[1]],
            [0.0, 0.0, 1.0],
        ],
        "frame": frame,
        "frame_from_camera": (matrix + 0.0).tolist(),  # without negative zeros
    }
