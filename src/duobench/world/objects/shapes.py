"""Convex building blocks, given by full sizes in metres and a pose in their solid's frame."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from duobench.core.errors import TaskError
from duobench.core.spatial import SE3
from duobench.core.types import LONGEST, Array, check_unit

CIRCLE_SEGMENTS = 64
"""Segments of a circle in images and prints."""
Z_TO_X = SE3(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
"""Rotation that turns z into x."""

# Objects are printed solid (100 % infill) in PLA, so that they weigh what a simulation gives them.
PRINTER = 0.256
"""Edge in metres of the cube that a printer fills: that of the paper's Bambu Lab X1C."""
KEPT_FREE = (0.018, 0.028)
"""Width and depth in metres of the corner at the front left of its bed where the nozzle is wiped,
and nothing is printed: read in a profile of that printer, which was not run."""
THINNEST_WALL = 0.0008
"""Thinnest wall in metres that is printed reliably: two lines of a nozzle of 0.4 mm."""
JOINT_PLAY = 0.0002
"""Play in metres on each side of a joint that is put together once and glued: a printer with a
nozzle of 0.4 mm is off by 0.1 to 0.2 mm, and a gap of that width still holds glue."""
OVERLAP = 0.002
"""How deep in metres shapes of one body reach into each other: shells that only touch may be two
bodies to a printer's software."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, each 0 to 1."""


def check_colour(colour: Colour | None) -> None:
    """Reject what is no colour."""
    if colour is None:
        return
    if len(colour) != 4 or not all(0 <= part <= 1 for part in colour):  # noqa: PLR2004 - opacity
        raise TaskError(
            f"A colour is red, green, blue and opacity, each from 0 to 1; got {colour}."
        )


class ShapeKind(StrEnum):
    """Kind of a shape."""

    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    HULL = "hull"


@dataclass(frozen=True, kw_only=True, slots=True)
class Shape:
    """One convex block; made by `box`, `cylinder`, `sphere`, `prism` or `hull`."""

    kind: ShapeKind
    """Which of them it is."""
    size: tuple[float, ...] = ()
    """Box: x y z edges. Cylinder: radius, height. Sphere: radius. Metres."""
    points: tuple[tuple[float, float, float], ...] = ()
    """Corners of a hull in its own frame, in metres."""
    pose: SE3 = field(default_factory=SE3)
    """Pose in the solid's frame."""
    rgba: Colour | None = None
    """Colour, where it differs from the solid's."""
    shadow: bool = True
    """Whether it casts one; not where the shadow lies within that of the shape below."""

    def __post_init__(self) -> None:
        check_colour(self.rgba)
        if not all(0 < edge <= LONGEST for edge in self.size):
            raise TaskError(
                f"The sizes of a {self.kind} are above 0 and at most {LONGEST:g}, in metres; got "
                f"{self.size}."
            )
        for point in self.points:
            check_unit("A coordinate of a hull", "metres", LONGEST, *point)

    def corners(self) -> Array:
        """Points (n, 3) whose convex hull is the shape, in the solid's frame, in metres.

        Round shapes are sampled finely enough for a lowest point within 0.1 mm at these sizes.
        """
        if self.kind is ShapeKind.BOX:
            signs = np.array(
                [[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]
            )
            local = signs * np.array(self.size) / 2
        elif self.kind is ShapeKind.CYLINDER:
            radius, height = self.size
            ring = radius * circle(CIRCLE_SEGMENTS)
            local = np.vstack(
                [at_height(ring, -height / 2), at_height(ring, height / 2)]
            )
        elif self.kind is ShapeKind.SPHERE:
            angles = np.linspace(0, math.pi, CIRCLE_SEGMENTS // 2 + 1)
            ring = circle(CIRCLE_SEGMENTS)
            local = np.vstack(
                [at_height(math.sin(a) * ring, math.cos(a)) for a in angles]
            )
            local = local * self.size[0]
        else:
            local = np.array(self.points)
        return self.pose.apply(local)


def circle(segments: int, phase: float = 0.0) -> Array:
    """Points (segments, 2) on the unit circle, counter-clockwise from angle `phase` in radians."""
    angles = [phase + 2 * math.pi * number / segments for number in range(segments)]
    return np.array([(math.cos(angle), math.sin(angle)) for angle in angles])


def polygon(corners: int, apothem: float) -> list[list[float]]:
    """Corners of a regular polygon with a side that faces x, so far from its middle in metres."""
    phase = math.pi / corners
    return (apothem / math.cos(phase) * circle(corners, phase)).tolist()


def at_height(points: Array, z: float) -> Array:
    """Points (n, 3) above points (n, 2) of the plane."""
    return np.column_stack([points, np.full(len(points), z)])


def box(
    x: float, y: float, z: float, *, at: SE3 | None = None, rgba: Colour | None = None
) -> Shape:
    """A box.

    Args:
        x: Edge along x in metres.
        y: Edge along y in metres.
        z: Edge along z in metres.
        at: Pose of its centre in the solid's frame; the identity by default.
        rgba: Colour, where it differs from the solid's.
    """
    return Shape(
        kind=ShapeKind.BOX,
        size=(x, y, z),
        pose=at or SE3(),
        rgba=rgba,
    )


def ring_wall(
    segments: int, radius: float, thickness: float, height: float, *, low: float = 0.0
) -> tuple[Shape, ...]:
    """An upright wall around z, made of boxes, the first of which faces x.

    Args:
        segments: Number of boxes.
        radius: Distance from the axis to the outside of each box, in metres.
        thickness: Thickness of the wall in metres.
        height: Height of the wall in metres.
        low: Height of its lower edge in metres.
    """
    edge = 2 * radius * math.tan(math.pi / segments)
    middle = SE3.at(radius - thickness / 2, 0.0, low + height / 2)
    return tuple(
        box(
            thickness,
            edge,
            height,
            at=SE3.at(yaw=2 * math.pi * k / segments) @ middle,
        )
        for k in range(segments)
    )


def cylinder(
    radius: float, height: float, *, at: SE3 | None = None, rgba: Colour | None = None
) -> Shape:
    """A cylinder about the z axis of its frame.

    Args:
        radius: Radius in metres.
        height: Height in metres.
        at: Pose of its centre in the solid's frame; the identity by default.
        rgba: Colour, where it differs from the solid's.
    """
    return Shape(
        kind=ShapeKind.CYLINDER, size=(radius, height), pose=at or SE3(), rgba=rgba
    )


def sphere(
    radius: float, *, at: SE3 | None = None, rgba: Colour | None = None
) -> Shape:
    """A ball.

    Args:
        radius: Radius in metres.
        at: Pose of its centre in the solid's frame; the identity by default.
        rgba: Colour, where it differs from the solid's.
    """
    return Shape(
        kind=ShapeKind.SPHERE,
        size=(radius,),
        pose=at or SE3(),
        rgba=rgba,
    )


def hull(
    points: Sequence[Sequence[float]],
    *,
    at: SE3 | None = None,
    rgba: Colour | None = None,
) -> Shape:
    """The convex hull of points.

    Args:
        points: Points (n, 3) in its own frame, in metres.
        at: Pose of that frame in the solid's; the identity by default.
        rgba: Colour, where it differs from the solid's.
    """
    rows = tuple((float(p[0]), float(p[1]), float(p[2])) for p in points)
    return Shape(
        kind=ShapeKind.HULL,
        points=rows,
        pose=at or SE3(),
        rgba=rgba,
    )


def prism(
    outline: Sequence[Sequence[float]],
    height: float,
    *,
    at: SE3 | None = None,
    rgba: Colour | None = None,
    taper: float = 1.0,
    shadow: bool = True,
) -> Shape:
    """A convex outline, extruded along z.

    Args:
        outline: Corners (n, 2) in the x-y plane, in metres.
        height: Height in metres; half of it is above the plane and half below.
        at: Pose of its frame in the solid's; the identity by default.
        rgba: Colour, where it differs from the solid's.
        taper: Size of the top over that of the bottom.
        shadow: Whether it casts one.
    """
    flat = np.asarray(outline, dtype=np.float64)
    points = np.vstack(
        [at_height(flat, -height / 2), at_height(flat * taper, height / 2)]
    )
    return replace(hull(points.tolist(), at=at, rgba=rgba), shadow=shadow)
