"""Where objects stand: outlines on the table, with numbers that a person can measure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from duobench.fabrication.sheet import CONTACT, outlines_of
from duobench.objects.prop import Prop
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
    seen: tuple[Array, ...]
    """Outlines (n, 2) as seen from above, in metres in the table frame."""
    contact: tuple[Array, ...]
    """Outlines (n, 2) of what touches the table."""


def footprints(props: Sequence[Prop], layout: Layout) -> list[Footprint]:
    """The footprints of a layout's objects, in the order of the task.

    Objects that stand in others, such as marbles in a cup, are left out: they are placed with them.
    """
    found: list[Footprint] = []
    for prop in props:
        pose = layout.poses[prop.name]
        x, y, z = pose.translation.tolist()
        if any(_holds(other.seen, (x, y)) and z * 1e3 > other.z_mm for other in found):
            continue
        seen, contact = (
            _on_table(outlines_of(prop, layout.variants, below=below), pose)
            for below in (None, CONTACT)
        )
        found.append(
            Footprint(
                number=len(found) + 1,
                name=prop.name,
                x_mm=round(1e3 * x, 1) + 0.0,
                y_mm=round(1e3 * y, 1) + 0.0,
                z_mm=round(1e3 * z, 1) + 0.0,
                yaw_deg=round(math.degrees(pose.yaw), 1) + 0.0,
                seen=seen,
                contact=contact,
            )
        )
    return found


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


def _on_table(outlines: Iterable[Array], pose: SE3) -> tuple[Array, ...]:
    """Outlines in an object's frame as points (n, 2) of the table frame."""
    upright = SE3.at(*pose.translation[:2], yaw=pose.yaw)
    return tuple(
        upright.apply(np.column_stack([outline, np.zeros(len(outline))]))[:, :2]
        for outline in outlines
    )


def _holds(outlines: Iterable[Array], point: tuple[float, float]) -> bool:
    """Whether a point is inside one of some outlines: a ray from it crosses an odd number of edges.

    Source: M. Shimrat, "Algorithm 112: Position of point relative to polygon", Communications of
    the ACM 5 (1962).
    """
    x, y = point
    for outline in outlines:
        ends = np.roll(outline, -1, axis=0)
        crossing = (outline[:, 1] > y) != (ends[:, 1] > y)
        start, end = outline[crossing], ends[crossing]
        at = start[:, 0] + (y - start[:, 1]) * (end - start)[:, 0] / (end - start)[:, 1]
        if np.count_nonzero(at > x) % 2:
            return True
    return False
