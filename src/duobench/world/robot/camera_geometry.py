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
    MUJOCO_FROM_OPENCV,
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
    Camera,
    RobotCamera,
    cameras_with,
)
from duobench.world.robot.gripper import DEFAULT_GRIPPER, GRIPPERS, Gripper

NO_OFFSETS: Mapping[str, tuple[SE3, float]] = {}


def named(
    camera: Any, gripper: Gripper = GRIPPERS[DEFAULT_GRIPPER]
) -> RobotCamera | Camera:
    """The description of a camera of the robot by its name; one of one's own as it is."""
    cameras = cameras_with(gripper)
    if isinstance(camera, Camera):
        return camera
    check_known("camera", camera, cameras)
    return cameras[camera]


def matrix_of(camera: RobotCamera | Camera, size: tuple[int, int]) -> Array:
    """Intrinsic matrix K (3, 3) in pixels of an image of a size; see `CameraGeometry`."""
    height, width = size
    if isinstance(camera, Camera):
        down = across = height / 2 / math.tan(math.radians(camera.fovy_deg) / 2)
    else:
        across = camera.focal * width / NATIVE_WIDTH
        down = camera.focal * height / NATIVE_HEIGHT
    middle = (width - 1) / 2, (height - 1) / 2
    return np.array([[across, 0, middle[0]], [0, down, middle[1]], [0, 0, 1]])


def mount_pose(arm: Side | None, tcp_poses: Array, gripper: Gripper) -> SE3:
    """Pose in the table frame of what a camera is on: the table, or the flange of an arm.

    The tool poses (2, 7) are those of a `DuoState`.
    """
    if arm is None:
        return SE3()
    return SE3.from_tquat(tcp_poses[arm.index]) @ SE3.at(z=-gripper.tool_offset)


def geometries(
    sizes: Sizes,
    tcp_poses: Array,
    gripper: Gripper,
    offsets: Mapping[str, tuple[SE3, float]] = NO_OFFSETS,
) -> dict[str, CameraGeometry]:
    """Lens and place of each camera where the tools are, by name.

    Args:
        sizes: Height and width of the images of each.
        tcp_poses: Tool poses (2, 7), those of a `DuoState`.
        gripper: Gripper on the arms.
        offsets: Of cameras that were moved, the pose in the nominal one, with MuJoCo's axes, and
            the radians that are added to the vertical field of view.
    """
    found = {}
    for key, size in sizes.items():
        camera = named(key, gripper)
        moved, angle = offsets.get(camera.name, (SE3(), 0.0))
        matrix = matrix_of(camera, size)
        half = math.atan(size[0] / 2 / matrix[1, 1])
        matrix[[0, 1], [0, 1]] *= math.tan(half) / math.tan(half + angle / 2)
        pose = mount_pose(camera.arm, tcp_poses, gripper) @ camera.pose @ moved
        found[camera.name] = geometry(matrix, pose)
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
    distances, lens, pose = (
        np.asarray(each, dtype=np.float64)
        for each in (depth, matrix, table_from_camera)
    )
    image = None if rgb is None else np.asarray(rgb)
    has_colours = image is None or image.shape == (*distances.shape, 3)
    is_image = len(distances.shape) == 2  # noqa: PLR2004 - height and width
    if not (is_image and lens.shape == (3, 3) and pose.shape == (4, 4) and has_colours):
        raise OptionError(
            "depth has shape (height, width), matrix (3, 3), table_from_camera (4, 4), and rgb "
            f"(height, width, 3); got shapes {distances.shape}, {lens.shape}, {pose.shape}"
            + ("." if image is None else f" and {image.shape}.")
        )
    shows = np.isfinite(distances) & (distances > 0.0)
    rows, columns = np.nonzero(shows)
    z = distances[shows]
    x = (columns - lens[0, 2]) / lens[0, 0] * z
    y = (rows - lens[1, 2]) / lens[1, 1] * z
    points = SE3(pose[:3, :3], pose[:3, 3]).apply(np.stack([x, y, z], axis=-1))
    return points if image is None else (points, image[shows])
