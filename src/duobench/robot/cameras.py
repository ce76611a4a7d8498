"""The cameras in numbers: the size of their images, and the view for people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from duobench.errors import RenderingError
from duobench.spatial import SE3, length

NATIVE_HEIGHT, NATIVE_WIDTH = 720, 1280
"""Native image size of all three cameras in pixels."""
OVERVIEW = "overview"
"""A view of the whole scene for people; not part of any observation."""


def check_image_size(height: int, width: int) -> None:
    """Check that a camera can give images of a size, in pixels.

    Raises:
        RenderingError: The size is larger than the native one, or not positive.
    """
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
    """Pose of a MuJoCo camera (x right, y up, looking along -z).

    Args:
        eye: Position (3,) in the parent frame.
        direction: Viewing direction (3,), any length.
        up: A direction (3,) that shall point upwards in the image.
    """
    back = -direction / length(direction)
    right = np.cross(up, back)
    right /= length(right)
    return SE3(np.column_stack([right, np.cross(back, right), back]), eye)
