"""The cameras, each described once: name, lens, where it is mounted; and the view for people.

The scene builds them by these descriptions, policies and data are offered them by name, and real
images are made like theirs. Another camera is another row of `CAMERAS`, and its housing in
`scene.cameras`.

A camera of the robot is given by its intrinsics, so an image of any size shows the whole native
field of view: it equals the native 1280x720 image resized to that size. A `Camera` of one's own has
square pixels and no housing.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

from duobench.core.errors import OptionError, RenderingError, check_known
from duobench.core.spatial import SE3, length
from duobench.core.types import (
    SIDES,
    Side,
    as_several,
    as_size,
)
from duobench.world.robot.gripper import DEFAULT_GRIPPER, GRIPPERS, Gripper
from duobench.world.robot.workcell import (
    FLOOR_Z,
    ROOM_HEIGHT,
    ROOM_X,
    ROOM_Y,
)

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
WRIST_TILT = math.radians(20.0)
"""Tilt of a wrist camera from the flange's z towards the fingertips."""
OVERVIEW = "overview"
"""A view of the whole scene for people; not part of any observation."""
FARTHEST = 7.0
"""Distance along the optical axis in metres beyond which a camera shows nothing."""


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
class RobotCamera:
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


_HEAD = RobotCamera(
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


def _wrist(side: Side, gripper: Gripper) -> RobotCamera:
    """Describe the camera on an arm's wrist, which is the same on both arms."""
    return RobotCamera(
        name=wrist_name(side),
        kind=D405,
        arm=side,
        pose=looking(
            np.array(gripper.camera),
            np.array([-math.sin(WRIST_TILT), 0.0, math.cos(WRIST_TILT)]),
            np.array([1.0, 0.0, 0.0]),
        ),
        focal=650.0,  # 58 degrees vertically
    )


@cache
def cameras_with(gripper: Gripper) -> Mapping[str, RobotCamera]:
    """The cameras of the robot by their names, those of the wrists where a gripper has them."""
    cameras = (_HEAD, *(_wrist(side, gripper) for side in SIDES))
    return {camera.name: camera for camera in cameras}


CAMERAS = cameras_with(GRIPPERS[DEFAULT_GRIPPER])
"""The cameras of the robot by their names; with another gripper, wrists are elsewhere."""
POLICY_CAMERAS = tuple(CAMERAS)
"""The cameras that a policy may see, and sees if nothing else is said."""
ON_TABLE = "table"
FRAMES: Mapping[str, Side | None] = {
    ON_TABLE: None,
    **{f"{side}_flange": side for side in SIDES},
}
"""Frames that a camera of one's own may stand in, and the arm that each moves with."""
FOVY_DEG = (1.0, 150.0)
"""Smallest and largest vertical field of view of a camera of one's own, in degrees."""
_REACH = 2.0
"""Largest coordinate of a camera in the frame of a flange, in metres."""
_LONGEST = 100.0
"""Largest coordinate of a point that a camera looks at, in metres: beyond it is another unit."""
_NEAREST = 1e-6
"""Smallest distance of the point that a camera looks at, in metres."""
_PARALLEL = 1e-6
"""Sine of the angle to the upright direction below which a camera looks along it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Camera:
    """A camera of one's own: a pinhole with square pixels, upright, that no other camera sees.

    Plain data, which records and policies carry; nothing of the physics or of other cameras'
    images depends on it. A look's offsets and the shift *camera* leave it where it is.

    Args:
        name: Name in observations: a lower-case letter, then letters, digits and underscores.
        position: Position in metres (x, y, z) in the frame that it is on.
        look_at: Point in that frame which the middle of the image shows.
        fovy_deg: Vertical field of view in degrees; the horizontal one follows from the size.
        on: "table", whose frame stands still, or "left_flange" or "right_flange", whose z points
            out of the gripper.
        size: Height and width of its images in pixels, or None for those of the environment.

    Raises:
        OptionError: A value is invalid.
        UnknownNameError: There is no such frame.

    Example:
        >>> Camera(name="side", position=(0.5, 1.2, 0.5), look_at=(0.5, 0.0, 0.0)).on
        'table'
    """

    name: str
    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    fovy_deg: float = 60.0
    on: str = ON_TABLE
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        _check_name(self.name)
        check_known(f"frame of camera {self.name!r}", self.on, FRAMES)
        for name in ("position", "look_at"):
            object.__setattr__(self, name, self._point(name))
        eye, target = np.array(self.position), np.array(self.look_at)
        if length(target - eye) < _NEAREST:
            raise OptionError(
                f"Camera {self.name!r} looks at its own position {self.position}; look_at is "
                "another point, in the middle of its image."
            )
        self._check_place()
        low, high = FOVY_DEG
        if not _is_within(self.fovy_deg, low, high):
            raise OptionError(
                f"fovy_deg of camera {self.name!r} is {low:g} to {high:g} degrees, got "
                f"{self.fovy_deg!r}."
            )
        object.__setattr__(self, "fovy_deg", float(self.fovy_deg))
        if self.size is not None:
            size = as_size(self.size)
            if size is None or size[0] > NATIVE_HEIGHT or size[1] > NATIVE_WIDTH:
                raise OptionError(
                    f"size of camera {self.name!r} is (height, width) in pixels, at most "
                    f"{(NATIVE_HEIGHT, NATIVE_WIDTH)}, one number for a square, or None; got "
                    f"{self.size!r}."
                )
            object.__setattr__(self, "size", size)

    @property
    def arm(self) -> Side | None:
        """The arm that it moves with, on whose flange it is; None for one that stands still."""
        return FRAMES[self.on]

    @property
    def pose(self) -> SE3:
        """Pose in the frame that it is on, with MuJoCo's axes.

        Up in the image is the table's z, or the flange's x, as in the images of the wrists; of a
        camera that looks along it, the table's x, or the flange's z.
        """
        eye = np.array(self.position)
        direction = np.array(self.look_at) - eye
        up, other = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
        if self.arm is not None:
            up, other = other, up
        across = length(np.cross(up, direction))
        is_along = across <= _PARALLEL * length(direction)
        return looking(eye, direction, other if is_along else up)

    def _point(self, name: str) -> tuple[float, float, float]:
        """A point as three floats."""
        match as_several(getattr(self, name)):
            case (x, y, z) if all(
                _is_within(each, -_LONGEST, _LONGEST) for each in (x, y, z)
            ):
                return float(x), float(y), float(z)
        raise OptionError(
            f"{name} of camera {self.name!r} is three finite numbers (x, y, z) in metres, at most "
            f"{_LONGEST:g} either way; got {getattr(self, name)!r}."
        )

    def _check_place(self) -> None:
        """Reject a place outside of the room, or far from the flange that carries it."""
        room = (ROOM_X, ROOM_Y, (FLOOR_Z, FLOOR_Z + ROOM_HEIGHT))
        ends = room if self.arm is None else ((-_REACH, _REACH),) * 3
        if not all(
            low < at < high for at, (low, high) in zip(self.position, ends, strict=True)
        ):
            words = ", ".join(
                f"{axis} {low:.2f} to {high:.2f}"
                for axis, (low, high) in zip("xyz", ends, strict=True)
            )
            where = "inside the room" if self.arm is None else f"near the {self.on}"
            raise OptionError(
                f"Camera {self.name!r} is {where}, at {words} m; got {self.position}."
            )


def view_from(camera: str | Camera) -> View:
    """The view of a camera that stands still: the head, or one of one's own on the table.

    Raises:
        UnknownNameError: There is no such camera.
        OptionError: It moves with an arm.
    """
    if isinstance(camera, str):
        check_known("camera that stands still", camera, (HEAD,))
        pose = CAMERAS[camera].pose
        forward = -pose.rotation[:, 2]
        eye = pose.translation
        target = eye - forward * (eye[2] / forward[2])  # on the table
        half = NATIVE_HEIGHT / 2 / CAMERAS[camera].focal
        x, y, z = eye.tolist()
        at_x, at_y, at_z = target.tolist()
        return View(
            eye=(x, y, z),
            target=(at_x, at_y, at_z),
            fovy_deg=math.degrees(2 * math.atan(half)),
        )
    if camera.on != "table":
        raise OptionError(
            f"Camera {camera.name!r} moves with an arm; a view begins at one that stands on the "
            "table."
        )
    return View(
        eye=camera.position,
        target=camera.look_at,
        fovy_deg=camera.fovy_deg,
    )


def camera_of(given: Mapping[str, Any]) -> Camera:
    """A camera of one's own from its fields, whose values may be as loose as `Camera` takes them.

    Raises:
        OptionError: A value is invalid, or missing.
        UnknownNameError: There is no such field.
    """
    known = [each.name for each in fields(Camera)]
    for name in given:
        check_known("field of a camera", name, known)
    missing = [name for name in ("name", "position", "look_at") if name not in given]
    if missing:
        raise OptionError(
            f"A camera has a name, a position and look_at; {', '.join(missing)} is missing in "
            f"{dict(given)!r}."
        )
    return Camera(**given)


def _check_name(name: object) -> None:
    if not isinstance(name, str) or not re.fullmatch("[a-z][a-z0-9_]{0,39}", name):
        raise OptionError(
            "The name of a camera is a lower-case letter, then letters, digits and underscores, "
            f"at most 40, such as 'side'; got {name!r}."
        )
    if name in (*CAMERAS, OVERVIEW):
        raise OptionError(
            f"The robot has a camera {name!r}; give one of your own another name, such as "
            f"'my_{name}'."
        )


def _is_within(value: object, low: float, high: float) -> bool:
    """Whether this is a real number, Python's or NumPy's and no boolean, within bounds."""
    is_real = isinstance(value, int | float | np.integer | np.floating)
    return is_real and not isinstance(value, bool) and bool(low <= value <= high)


MUJOCO_FROM_OPENCV = SE3(np.diag([1.0, -1.0, -1.0]))
"""A camera with OpenCV's axes (x right, y down, z forwards) in one with MuJoCo's."""


def describe_cameras(
    gripper: Gripper = GRIPPERS[DEFAULT_GRIPPER],
) -> dict[str, dict[str, Any]]:
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
    return {
        name: _describe(camera, gripper)
        for name, camera in cameras_with(gripper).items()
    }


def _describe(camera: RobotCamera, gripper: Gripper) -> dict[str, Any]:
    height, width = camera.size
    middle = (width - 1) / 2, (height - 1) / 2
    frame, pose = "table", camera.pose
    if camera.arm is not None:
        frame = f"{camera.arm}_tool"
        pose = SE3.at(z=-gripper.tool_offset) @ pose
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
