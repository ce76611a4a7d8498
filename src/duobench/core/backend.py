"""Interface between an environment and two arms: commands in, state and images out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from duobench.core.types import (
    ARM_JOINTS,
    CONTROL_HZ,
    SIDE_SIZE,
    SIDES,
    Array,
    DuoCommand,
    DuoState,
)

Image = NDArray[np.uint8]
"""An image (height, width, 3), red green blue, top row first."""
RGB, DEPTH, SEGMENTATION = "rgb", "depth", "segmentation"
KINDS = (RGB, DEPTH, SEGMENTATION)
"""Kinds of images: `Image`; float32 (height, width) with the distance along the optical axis in
metres, 0 where there is none; int32 (height, width) with the number of the part that is shown, 0
where nothing is."""


class AnyCamera(Protocol):
    """A camera of one's own, as `duobench.Camera` describes it."""

    @property
    def name(self) -> str:
        """Name of its images."""
        ...


Sizes = Mapping[str | AnyCamera, tuple[int, int]]
"""Height and width of images in pixels, by the name of a camera of the robot, or by a camera."""
Wanted = Mapping[str, Sizes]
"""Images that are wanted at once, by their kind."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class CameraGeometry:
    """Lens and place of a camera for images of one size, in OpenCV's axes.

    The camera's x points right in the image, y down, z into the scene. The middle of the top left
    pixel is (0, 0), and there is no distortion. So a point (3,) of the table frame is shown at
    `p = matrix @ (camera_from_table @ [*point, 1])[:3]`, `p[:2] / p[2]`.
    """

    matrix: Array
    """Intrinsic matrix K (3, 3) in pixels; (n, 3, 3) of several environments."""
    table_from_camera: Array
    """Pose of the camera in the table frame (4, 4), in metres; (n, 4, 4) of several."""


SPEED_UP = 0.5
"""Part of its speed limit by which a joint may get faster in a control step: a target leads one
that is slow by less."""


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class DuoLimits:
    """Limits of the arms; arrays (16,) in the order of `DuoCommand.flat`."""

    low: Array
    """Smallest joint targets in radians, and openings."""
    high: Array
    """Largest joint targets in radians, and openings."""
    max_change: Array
    """Largest change in one control step: joints move at their speed limits at most. Infinite for
    grippers, which take any opening and go there at the speed of their motor."""
    lead: Array
    """Largest distance of a joint target from where the joint will be after the control step, at
    the speed that it has, if that is its limit: one that fell behind further would catch up faster
    than it may. Infinite for grippers, and where arms bound their speed by themselves."""

    def clip(
        self, targets: Array, last: Array, measured: Array, velocities: Array
    ) -> Array:
        """The command nearest to some targets (16,) that can follow the last command (16,).

        It leads joints by no more than they can follow, unless the last command does so already:
        it then comes back at the speed limits. What was clipped stays as it is when it is clipped
        again. Rows (n, 16), with velocities (n, 2, 7), are clipped each alone.

        Args:
            targets: What is asked for.
            last: The command before.
            measured: Where joints and grippers are (16,).
            velocities: How fast the joints turn (2, 7), in rad/s.
        """
        ways = np.zeros_like(measured)
        ways.reshape(-1, len(SIDES), SIDE_SIZE)[..., :ARM_JOINTS] = (
            velocities / CONTROL_HZ
        )
        ways = np.minimum(np.maximum(ways, -self.max_change), self.max_change)
        shares = ways / self.max_change
        up = self.lead * np.minimum(np.maximum(shares, 0.0) + SPEED_UP, 1.0)
        down = self.lead * np.minimum(np.maximum(-shares, 0.0) + SPEED_UP, 1.0)
        # A reading that is no number limits nothing; who reads it says what is wrong.
        there = measured + ways
        led = np.fmin(np.fmax(targets, there - down), there + up)
        low = np.maximum(self.low, last - self.max_change)
        high = np.minimum(self.high, last + self.max_change)
        return np.minimum(np.maximum(led, low), high)


class DuoBackend(Protocol):
    """Two arms with grippers and cameras, driven one control step at a time.

    Commands are followed between `start` and `stop`, unless something holds the arms: a person, or
    a check that finds something wrong. Only `home` ends a hold.
    """

    def start(self) -> None:
        """Begin to follow commands from where the arms are; nothing moves. Twice is harmless.

        Raises:
            BackendError: Arms, grippers or cameras cannot be reached.
        """
        ...

    def stop(self) -> None:
        """Come to rest and follow no more commands until `start`; stopping twice is harmless."""
        ...

    def home(self) -> None:
        """Move to the home configuration with open grippers, and wait there; ends a hold.

        Raises:
            BackendError: The arms cannot get there.
        """
        ...

    def hold(self, reason: str) -> None:
        """Bring both arms to rest and hold them there: until `home`, commands move nothing.

        It may be called from any thread, and again: the first reason, which is for people, is kept.
        """
        ...

    @property
    def held(self) -> str | None:
        """Reason why the arms are held; None while they follow commands."""
        ...

    def health(self) -> str | None:
        """Description of problems of arms, grippers or cameras; None while all is well."""
        ...

    def image_ages(self) -> Mapping[str, float]:
        """Seconds since the latest image of each camera that takes them by itself was taken."""
        ...

    @property
    def robot(self) -> Any:
        """Description of the arms, a `world.robot.frames.Robot`."""
        ...

    @property
    def limits(self) -> DuoLimits:
        """Limits of the arms."""
        ...

    @property
    def last_command(self) -> DuoCommand:
        """The command that was really sent last; before the first one, where the arms are held."""
        ...

    @property
    def time(self) -> float:
        """Time of the latest measured state in seconds, on a monotonic clock."""
        ...

    def read(self) -> DuoState:
        """The latest state of the arms."""
        ...

    def joint_velocities(self) -> Array:
        """Joint velocities (2, 7) in rad/s, left then right, of the latest state."""
        ...

    def command(self, command: DuoCommand) -> DuoCommand:
        """Move towards a command for one control step.

        Returns:
            The command that was really sent, which may differ from `command`. While the arms are
            held, that is the last one.
        """
        ...

    def images(
        self, cameras: Sequence[str], shape: tuple[int, int]
    ) -> Mapping[str, Image]:
        """The latest image of each of some cameras, by name; shape is height and width in pixels.

        Raises:
            UnknownNameError: There is no such camera.
            RenderingError: No image of that size can be had.
        """
        ...

    def images_by_kind(self, wanted: Wanted) -> Mapping[str, Mapping[str, Any]]:
        """The latest images of several kinds and sizes, of one state, by kind and name of a camera.

        Raises:
            UnknownNameError: There is no such camera.
            BackendError: A camera gives no images of that kind.
            RenderingError: No image of that size can be had.
        """
        ...

    def camera_geometry(self, sizes: Sizes) -> Mapping[str, CameraGeometry]:
        """Lens and present place of some cameras by name, for images of some sizes."""
        ...

    def close(self) -> None:
        """Free what images need and let go of hardware; closing twice is harmless."""
        ...
