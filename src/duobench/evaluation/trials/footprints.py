"""Where objects stand: outlines on the table, with numbers that a person can measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from duobench.objects.prop import Prop
from duobench.objects.solid import corner_points
from duobench.robot.cameras import (
    HEAD_FOCAL,
    MUJOCO_FROM_OPENCV,
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
    TABLE_FROM_HEAD,
)
from duobench.sim.layout import Layout
from duobench.spatial import SE3
from duobench.types import Array

_NEAREST_M = 0.05
"""What is nearer to the camera's plane than this is not projected."""
_FLAT = 3
"""Points of an outline, at least."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Footprint:
    """Where one object stands."""

    number: int
    """Number beside its outline, from 1 on."""
    name: str
    """Name of the object."""
    x_mm: float
    """Its origin from the middle of the robot's base forwards, in millimetres."""
    y_mm: float
    """Likewise to the left."""
    z_mm: float
    """Height of its origin above the table."""
    yaw_deg: float
    """Turn about the vertical in degrees, counter-clockwise from above, from -180 to 180."""
    outline: Array
    """Convex outline (n, 2) seen from above, counter-clockwise, in metres in the table frame."""


def footprints(props: Sequence[Prop], layout: Layout) -> list[Footprint]:
    """The footprints of a layout's objects, in the order of the task.

    Objects that stand in others, such as marbles in a cup, are left out: they are placed with them.
    """
    found: list[Footprint] = []
    for prop in props:
        pose = layout.poses[prop.name]
        x, y, z = pose.translation.tolist()
        yaw = math.degrees(math.atan2(pose.rotation[1, 0], pose.rotation[0, 0]))
        outline = outline_of(prop, pose)
        if any(_holds(other.outline, (x, y)) and z * 1e3 > other.z_mm for other in found):
            continue
        found.append(
            Footprint(
                number=len(found) + 1,
                name=prop.name,
                x_mm=round(1e3 * x, 1) + 0.0,
                y_mm=round(1e3 * y, 1) + 0.0,
                z_mm=round(1e3 * z, 1) + 0.0,
                yaw_deg=round(yaw, 1) + 0.0,
                outline=outline,
            )
        )
    return found


def outline_of(prop: Prop, pose: SE3) -> Array:
    """Convex outline (n, 2) of an object at a pose, seen from above, in metres."""
    points = [corner_points(prop.solid)]
    points += [part.pose.apply(corner_points(part.solid)) for part in prop.parts]
    return convex_hull(pose.apply(np.concatenate(points))[:, :2])


def convex_hull(points: Array) -> Array:
    """The corners (m, 2) of the convex hull of points (n, 2), counter-clockwise.

    Source: A. M. Andrew, "Another efficient algorithm for convex hulls in two dimensions",
    Information Processing Letters 9 (1979).
    """
    ordered = np.unique(np.round(points, 6), axis=0).tolist()
    if len(ordered) < _FLAT:
        return np.array(ordered)

    def chain(line: Sequence[list[float]]) -> list[list[float]]:
        kept: list[list[float]] = []
        for x, y in line:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2], kept[-1]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                    break
                kept.pop()
            kept.append([x, y])
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def project(points: Array, table_from_camera: SE3 = TABLE_FROM_HEAD) -> Array:
    """Where points (n, 3) of the table frame, in metres, are in a native image of the head camera.

    Args:
        points: The points.
        table_from_camera: Pose of the camera with MuJoCo's axes.

    Returns:
        Pixels (n, 2) across and down, the middle of the top left one is (0, 0); NaN for points
        behind the camera.
    """
    camera = (table_from_camera @ MUJOCO_FROM_OPENCV).inverse().apply(points)
    depth = np.where(camera[:, 2:] > _NEAREST_M, camera[:, 2:], np.nan)
    middle = np.array([(NATIVE_WIDTH - 1) / 2, (NATIVE_HEIGHT - 1) / 2])
    return HEAD_FOCAL * camera[:, :2] / depth + middle


def _holds(outline: Array, point: tuple[float, float]) -> bool:
    """Whether a point is inside a convex outline."""
    if len(outline) < _FLAT:
        return False
    edges = np.roll(outline, -1, axis=0) - outline
    to = np.array(point) - outline
    return bool((edges[:, 0] * to[:, 1] - edges[:, 1] * to[:, 0] > 0).all())
