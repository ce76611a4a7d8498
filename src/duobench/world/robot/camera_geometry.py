"""Lenses and places of cameras as matrices, and the points that a depth image shows."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from duobench.core.backend import CameraGeometry, Sizes
from duobench.core.errors import OptionError, check_known
from duobench.core.spatial import SE3
from duobench.core.types import Array, Side
from duobench.world.robot.cameras import (
    CAMERAS,
    MUJOCO_FROM_OPENCV,
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
    Camera,
    RobotCamera,
)
from duobench.world.robot.gripper import GRIPPER

Offset = tuple[SE3, float]
"""Pose of a camera in the nominal one, with MuJoCo's axes, and radians that are added to its
vertical field of view."""
NO_OFFSETS: Mapping[str, Offset] = {}


def named(camera: Any) -> RobotCamera | Camera:
    """The description of a camera of the robot by its name; one of one's own as it is."""
    if isinstance(camera, Camera):
        return camera
    check_known("camera", camera, CAMERAS)
    return CAMERAS[camera]


def focal_lengths(
    camera: RobotCamera | Camera, size: tuple[int, int]
) -> tuple[float, float]:
    """Focal lengths across and down in pixels of an image of a size (height, width)."""
    height, width = size
    if isinstance(camera, RobotCamera):
        return (
            camera.focal * width / NATIVE_WIDTH,
            camera.focal * height / NATIVE_HEIGHT,
        )
    focal = height / 2 / math.tan(math.radians(camera.fovy_deg) / 2)
    return focal, focal


def matrix_of(
    camera: RobotCamera | Camera, size: tuple[int, int], widening: float = 1.0
) -> Array:
    """Intrinsic matrix K (3, 3) in pixels of an image of a size; see `CameraGeometry`.

    A view that is widened by 2 shows everything half as large.
    """
    height, width = size
    across, down = focal_lengths(camera, size)
    return np.array(
        [
            [across / widening, 0.0, (width - 1) / 2],
            [0.0, down / widening, (height - 1) / 2],
            [0.0, 0.0, 1.0],
        ]
    )


def mount_pose(arm: Side | None, tcp_poses: Array) -> SE3:
    """Pose in the table frame of what a camera is on: the table, or the flange of an arm.

    The tool poses (2, 7) are those of a `DuoState`.
    """
    if arm is None:
        return SE3()
    return SE3.from_tquat(tcp_poses[arm.index]) @ SE3.at(z=-GRIPPER.tool_offset)


def geometries(
    sizes: Sizes, tcp_poses: Array, offsets: Mapping[str, Offset] = NO_OFFSETS
) -> dict[str, CameraGeometry]:
    """Lens and place of each camera where the tools are, by name.

    Args:
        sizes: Height and width of the images of each.
        tcp_poses: Tool poses (2, 7), those of a `DuoState`.
        offsets: Offsets of cameras, such as a look's, by name.
    """
    found = {}
    for key, size in sizes.items():
        camera = named(key)
        pose = mount_pose(camera.arm, tcp_poses) @ camera.pose
        offset = offsets.get(camera.name)
        widening = 1.0
        if offset is not None:
            moved, angle = offset
            pose = pose @ moved
            half = math.atan(size[0] / 2 / focal_lengths(camera, size)[1])
            widening = math.tan(half + angle / 2) / math.tan(half)
        found[camera.name] = geometry(matrix_of(camera, size, widening), pose)
    return found


def geometry(matrix: Array, table_from_camera: SE3) -> CameraGeometry:
    """Geometry of a camera, whose pose is given with MuJoCo's axes."""
    pose = table_from_camera @ MUJOCO_FROM_OPENCV
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = pose.rotation, pose.translation
    return CameraGeometry(matrix=matrix, table_from_camera=transform)


def point_cloud(
    depth: ArrayLike,
    matrix: ArrayLike,
    table_from_camera: ArrayLike,
    rgb: ArrayLike | None = None,
) -> Any:
    """Points of the table frame that a depth image shows, row by row, in metres.

    Args:
        depth: Distances along the optical axis (height, width) in metres; pixels without one, 0 or
            not finite, give no point.
        matrix: Intrinsic matrix (3, 3) for this size of image.
        table_from_camera: Pose of the camera (4, 4), in OpenCV's axes; with that of another frame,
            the points are in that one.
        rgb: Image (height, width, 3) from the same camera.

    Returns:
        Points (n, 3), float64; with an image also the colour of each (n, 3), as a second array.

    Raises:
        OptionError: An array has another shape.

    Example:
        >>> seen = env.cameras["head"]
        >>> point_cloud(observation["depth"]["head"], seen.matrix, seen.table_from_camera)
    """
    distances = _shaped("depth", depth, (None, None))
    lens = _shaped("matrix", matrix, (3, 3))
    pose = _shaped("table_from_camera", table_from_camera, (4, 4))
    shows = np.isfinite(distances) & (distances > 0.0)
    rows, columns = np.nonzero(shows)
    z = distances[shows]
    y = (rows - lens[1, 2]) / lens[1, 1] * z
    x = (columns - lens[0, 2]) / lens[0, 0] * z
    points = SE3(pose[:3, :3], pose[:3, 3]).apply(np.stack([x, y, z], axis=-1))
    if rgb is None:
        return points
    image = np.asarray(rgb)
    if image.shape != (*distances.shape, 3):
        raise OptionError(
            f"rgb has the shape of depth and 3 colours, {(*distances.shape, 3)}; got {image.shape}."
        )
    return points, image[shows]


def _shaped(name: str, values: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if len(array.shape) != len(shape) or any(
        asked not in (None, size)
        for asked, size in zip(shape, array.shape, strict=True)
    ):
        words = "(height, width)" if None in shape else str(shape)
        raise OptionError(
            f"{name} is an array {words}, got one of shape {array.shape}."
        )
    return array
