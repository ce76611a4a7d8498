"""Canonical camera model: images of a real camera, as the simulation's camera sees them.

Every real image is remapped once to the pinhole of the simulation's camera (740 px for the head and
650 px for the wrists at 1280x720, no distortion), and then resized to what is asked for. The place
of a camera is not changed: where it really is stands in its calibration.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures

from duobench.core.backend import (
    DEPTH,
    SEGMENTATION,
    Image,
    Wanted,
)
from duobench.core.errors import (
    BackendError,
    DataError,
    OptionError,
    check_known,
)
from duobench.core.spatial import SE3
from duobench.core.types import Array
from duobench.envs.camera_options import name_of
from duobench.real.devices import Camera, Depth, Frame
from duobench.real.rig import CameraCalibration, CameraConfig
from duobench.world.robot.cameras import (
    CAMERAS,
    MUJOCO_FROM_OPENCV,
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
    cameras_with,
)
from duobench.world.robot.gripper import DEFAULT_GRIPPER, GRIPPERS, Gripper

if TYPE_CHECKING:
    from duobench.data.images import View

NATIVE = (NATIVE_HEIGHT, NATIVE_WIDTH)
"""Height and width of a canonical image in pixels."""
_Floats = NDArray[np.float32]


def focal_of(camera: str) -> float:
    """Focal length in pixels of a camera's canonical image."""
    return CAMERAS[camera].focal


def nominal_pose(camera: str, gripper: Gripper = GRIPPERS[DEFAULT_GRIPPER]) -> SE3:
    """Return the pose of a simulated camera (x right, y down, z forwards) in its parent.

    The parent is the table for the head, and the flange for a wrist.
    """
    return cameras_with(gripper)[camera].pose @ MUJOCO_FROM_OPENCV


def distorted(points: Array, lens: CameraCalibration) -> Array:
    """Pixels (..., 2) in which a lens shows directions, by OpenCV's model, Brown and Conrady.

    Directions (..., 2) are x / z and y / z, x right, y down, z forwards.
    """
    x, y = points[..., 0], points[..., 1]
    k1, k2, p1, p2, k3 = lens.distortion
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    across = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([lens.fx * across + lens.cx, lens.fy * down + lens.cy], axis=-1)


class CanonicalView:
    """Makes canonical images of one camera's images of a size, height and width in pixels.

    Without a calibration they are only resized.
    """

    def __init__(
        self,
        camera: str,
        calibration: CameraCalibration | None,
        size: tuple[int, int] = NATIVE,
    ) -> None:
        focal = focal_of(camera)
        self.camera, self.size = camera, size
        self._map: _Floats | None = None
        if calibration is None:
            return
        rows, columns = np.mgrid[0:NATIVE_HEIGHT, 0:NATIVE_WIDTH]
        middle = np.array([(NATIVE_WIDTH - 1) / 2, (NATIVE_HEIGHT - 1) / 2])
        directions = (np.stack([columns, rows], axis=-1) - middle) / focal
        self._map = distorted(directions, calibration).astype(np.float32)

    @property
    def coverage(self) -> float:
        """Share of the canonical image that the camera sees; the rest is black."""
        if self._map is None:
            return 1.0
        return float(np.mean(_inside(self._map, self.size)))

    def image(self, image: Image, shape: tuple[int, int] = NATIVE) -> Image:
        """Make the canonical image of a camera's image, always as a new array.

        The shape is height and width; a pixel is the mean of what it covers.
        """
        if image.shape != (*self.size, 3):
            raise OptionError(
                f"Images of {self.camera} are {self.size[1]}x{self.size[0]} with 3 colours, got an "
                f"array of {image.shape}."
            )
        straight = image if self._map is None else _remapped(image, self._map)
        if straight.shape[:2] == shape:
            return straight.copy() if straight is image else straight
        height, width = shape
        picture = Pictures.fromarray(straight).resize(
            (width, height), Pictures.Resampling.BOX
        )
        return np.array(picture)

    def depth(self, depth: Depth, shape: tuple[int, int] = NATIVE) -> Depth:
        """Make the canonical depth of a camera's depth, as a new array.

        A pixel has the depth that was measured nearest to its middle: means of near and far would
        be where nothing is.
        """
        rows, columns = (
            (np.arange(pixels) + 0.5) / pixels for pixels in shape
        )  # as shares of the image
        height, width = self.size if self._map is None else NATIVE
        part = np.ix_((rows * height).astype(int), (columns * width).astype(int))
        if self._map is None:
            return depth[part]
        places = self._map[part]
        inside = _inside(places, self.size)
        x, y = np.rint(np.where(inside[..., None], places, 0.0)).astype(int).T
        return np.where(inside, depth[y.T, x.T], np.float32(0.0))


def _remapped(image: Image, places: _Floats) -> Image:
    try:
        import cv2  # pyright: ignore[reportMissingImports]
    except ImportError:
        return remapped(image, places)
    return cv2.remap(image, places, None, cv2.INTER_LINEAR)


def remapped(image: Image, places: NDArray[np.floating]) -> Image:
    """An image (height, width, 3) sampled at some places, by NumPy alone; OpenCV is faster.

    Places are pixels (h, w, 2), across then down, between which it is interpolated linearly; where
    one lies outside, the result (h, w, 3) is black.
    """
    height, width = image.shape[:2]
    inside = _inside(places, (height, width))
    x = np.where(inside, places[..., 0], 0.0)
    y = np.where(inside, places[..., 1], 0.0)
    left = np.minimum(x.astype(np.intp), width - 2)
    top = np.minimum(y.astype(np.intp), height - 2)
    across = (x - left)[..., None].astype(np.float32)
    down = (y - top)[..., None].astype(np.float32)
    upper = image[top, left] * (1 - across) + image[top, left + 1] * across
    lower = image[top + 1, left] * (1 - across) + image[top + 1, left + 1] * across
    mixed = upper * (1 - down) + lower * down
    mixed[~inside] = 0.0
    return np.rint(mixed).astype(np.uint8)


def _inside(places: NDArray[np.floating], size: tuple[int, int]) -> NDArray[np.bool_]:
    x, y = places[..., 0], places[..., 1]
    return (x >= 0) & (x <= size[1] - 1) & (y >= 0) & (y <= size[0] - 1)


class CanonicalViews:
    """Images of a rig's cameras as the simulated cameras would see; a view is made on first use."""

    def __init__(
        self, cameras: Mapping[str, Camera], configs: Mapping[str, CameraConfig]
    ) -> None:
        self._cameras, self._configs = cameras, configs
        self._views: dict[str, CanonicalView] = {}

    def images(self, wanted: Wanted) -> dict[str, dict[str, Any]]:
        """The latest images by kind and camera; those of a camera are of one frame."""
        check_seen(wanted, self._configs)
        frames = {name: camera.latest() for name, camera in self._cameras.items()}
        return {
            kind: {
                str(name): self._seen(kind, str(name), frames[str(name)], size)
                for name, size in sizes.items()
            }
            for kind, sizes in wanted.items()
        }

    def _seen(
        self, kind: str, name: str, frame: Frame | None, size: tuple[int, int]
    ) -> Any:
        if frame is None or (kind == DEPTH and frame.depth is None):
            raise BackendError(f"The camera {name} has given no image yet.")
        if name not in self._views:
            config = self._configs[name]
            self._views[name] = CanonicalView(name, config.calibration, config.size)
        view = self._views[name]
        if kind == DEPTH and frame.depth is not None:
            return view.depth(frame.depth, size)
        return view.image(frame.image, size)


def check_seen(wanted: Wanted, cameras: Mapping[str, CameraConfig]) -> None:
    """Reject images that the cameras of a rig do not give.

    Raises:
        UnknownNameError: The rig has no such camera.
        BackendError: A camera gives no images of that kind.
    """
    for kind, sizes in wanted.items():
        for camera in sizes:
            if not isinstance(camera, str) or kind == SEGMENTATION:
                raise BackendError(
                    "A rig gives images and depth of its own cameras alone; cameras of one's own, "
                    f"and segmentation, need a simulation. Got {kind} of {name_of(camera)!r}."
                )
            check_known("camera of this rig", camera, cameras)
            if kind == DEPTH and not cameras[camera].depth:
                able = [name for name, config in cameras.items() if config.depth]
                raise BackendError(
                    f"The camera {camera} of this rig gives no depth; {', '.join(able) or 'none'} "
                    "does. A ZED Mini gives colour alone; a RealSense camera has `depth` set to "
                    "true in the rig's file."
                )


def view_of(camera: str, about: Mapping[str, Any]) -> "View":
    """The view of a camera: its images as the simulation's camera would have taken them.

    It is the same that a policy has on the rig, for exports of what was recorded.

    Args:
        camera: Its name.
        about: What the rig's file said about it when it was recorded.
    """
    try:
        config = msgspec.convert(dict(about), CameraConfig)
    except msgspec.ValidationError as error:
        raise DataError(
            f"What is said about the camera {camera} is invalid: {error}"
        ) from error
    return CanonicalView(camera, config.calibration, config.size).image
