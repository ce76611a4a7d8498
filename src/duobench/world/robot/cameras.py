"""The cameras in numbers: lenses, where they are mounted, and the view for people.

A camera is given by its intrinsics, so an image of any size shows the whole native field of view:
it equals the native 1280x720 image resized to that size.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from duobench.core.errors import RenderingError
from duobench.core.spatial import SE3, length
from duobench.core.types import HEAD, SIDES, wrist_name
from duobench.world.robot.frames import TCP_OFFSET

NATIVE_HEIGHT, NATIVE_WIDTH = 720, 1280
"""Native image size of all three cameras in pixels."""
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


def looking(eye: np.ndarray, direction: np.ndarray, up: np.ndarray) -> SE3:
    """Pose of a MuJoCo camera (x right, y up, looking along -z) in the frame of the arguments.

    The direction (3,) has any length; `up` (3,) is what shall point upwards in the image.
    """
    back = -direction / length(direction)
    right = np.cross(up, back)
    right /= length(right)
    return SE3(np.column_stack([right, np.cross(back, right), back]), eye)


TABLE_FROM_HEAD = looking(
    np.array(HEAD_POSITION),
    np.array([math.cos(HEAD_PITCH), 0.0, -math.sin(HEAD_PITCH)]),
    np.array([0.0, 0.0, 1.0]),
)
"""Pose of the head camera in the table frame, with MuJoCo's axes."""
FLANGE_FROM_WRIST = looking(
    np.array(WRIST_POSITION),
    np.array([-math.sin(WRIST_TILT), 0.0, math.cos(WRIST_TILT)]),
    np.array([1.0, 0.0, 0.0]),
)
"""Pose of a wrist camera in the flange frame, with MuJoCo's axes; the same on both arms."""
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
    tool_from_wrist = SE3.at(z=-TCP_OFFSET) @ FLANGE_FROM_WRIST
    wrists = {
        wrist_name(side): _describe(WRIST_FOCAL, f"{side}_tool", tool_from_wrist) for side in SIDES
    }
    return {HEAD: _describe(HEAD_FOCAL, "table", TABLE_FROM_HEAD), **wrists}


def _describe(focal: float, frame: str, frame_from_mujoco: SE3) -> dict[str, Any]:
    middle = (NATIVE_WIDTH - 1) / 2, (NATIVE_HEIGHT - 1) / 2
    frame_from_camera = frame_from_mujoco @ MUJOCO_FROM_OPENCV
    matrix = np.eye(4)
    matrix[:3, :3] = frame_from_camera.rotation
    matrix[:3, 3] = frame_from_camera.translation
    return {
        "size": [NATIVE_HEIGHT, NATIVE_WIDTH],
        "intrinsics": [[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]],
        "frame": frame,
        "frame_from_camera": (matrix + 0.0).tolist(),  # without negative zeros
    }
