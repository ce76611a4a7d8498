"""What lies over the live image while objects are placed: outlines, the layout, and the robot.

Outlines have numbers that a person can measure. Layout and robot are rendered by the simulation,
from where the head camera was measured to be. Where robot and ghost do not agree in the image, the
calibration is wrong, and so is the layout.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from duobench.backend import Image
from duobench.errors import RenderingError
from duobench.fabrication.sheet import CONTACT, outlines_of
from duobench.hardware.rig import Rig
from duobench.objects.prop import Prop
from duobench.rig_sessions.cameras import jpeg
from duobench.robot.cameras import (
    HEAD_FOCAL,
    MUJOCO_FROM_OPENCV,
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
    TABLE_FROM_HEAD,
)
from duobench.sim.layout import Layout
from duobench.spatial import SE3
from duobench.tasks.task import Task
from duobench.types import HEAD, SIDES, Array, DuoCommand

if TYPE_CHECKING:
    from duobench.sim.rendering import Renderer

GHOST_OPACITY = 0.55
"""Opacity of the robot's ghost."""
_NEAREST_M = 0.05
"""What is nearer to the camera's plane than this is not projected."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Footprint:
    """Where one object stands."""

    number: int
    """Number beside its outline, from 1 on."""
    name: str
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


class Overlay:
    """Layouts of a task, and images of them from the head camera of a rig."""

    def __init__(self, task: Task, rig: Rig) -> None:
        """Compile the task's model; no OpenGL before the first image."""
        self.task = task
        """What is on the table."""
        from duobench.sim.simulation import Simulation

        self._simulation = Simulation(task.props)
        self._renderer: Renderer | None = None
        self.table_from_head = head_pose(rig)
        """Pose of the head camera in the table frame, with MuJoCo's axes."""
        camera = self._simulation.model.camera(HEAD)
        camera.pos[:] = self.table_from_head.translation
        camera.quat[:] = self.table_from_head.wxyz

    def layout(self, seed: int, split: str) -> Layout:
        """The layout of a seed, the same that the simulated environment begins with.

        Raises:
            LayoutError: There is none.
        """
        from duobench.sim.placement import first_valid

        sampled = first_valid(self._simulation, self.task.layouts(seed, split), self.task.id)
        return Layout.from_json(sampled.to_json())

    def images(self, layout: Layout, joints: Array) -> dict[str, bytes]:
        """What lies over the live image; nothing where nothing renders.

        Args:
            layout: Where the objects are.
            joints: Measured joints (2, 7) in radians.

        Returns:
            "layout", the whole scene as the head camera would see it, as JPEG; and "ghost", the
            robot alone on a transparent ground, as PNG.
        """
        simulation = self._simulation
        simulation.reset_data()
        simulation.duo.set_configuration(DuoCommand(joints=joints, openings=np.ones(2)))
        simulation.apply(layout)
        if self._renderer is None:
            from duobench.sim.rendering import Renderer

            self._renderer = Renderer(simulation.model, height=NATIVE_HEIGHT, width=NATIVE_WIDTH)
        try:
            image = self._renderer.render(simulation.data, HEAD)
            seen = self._renderer.segment(simulation.data, HEAD)
        except RenderingError:
            return {}  # outlines and numbers are there without
        alpha = np.isin(seen, self._robot_geoms()) * round(255 * GHOST_OPACITY)
        return {"layout": jpeg(image), "ghost": _png(np.dstack([image, alpha.astype(np.uint8)]))}

    def close(self) -> None:
        """Free what images need."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _robot_geoms(self) -> NDArray[np.intp]:
        model = self._simulation.model
        bodies = [model.body(int(number)).name for number in model.geom_bodyid]
        sides = tuple(f"{side}/" for side in SIDES)
        return np.flatnonzero([name.startswith(sides) for name in bodies])


def head_pose(rig: Rig) -> SE3:
    """Pose of a rig's head camera in the table frame, with MuJoCo's axes, if need be nominal."""
    camera = rig.cameras.get(HEAD)
    if camera is None or camera.calibration is None:
        return TABLE_FROM_HEAD
    return SE3.from_tquat(camera.calibration.pose) @ MUJOCO_FROM_OPENCV.inverse()


def _png(image: Image) -> bytes:
    buffer = io.BytesIO()
    Pillow.fromarray(image, "RGBA").save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()
