"""Overlays of the live image while objects are placed: outlines, the layout, and the robot.

Outlines have numbers that a person can measure. Layout and robot are rendered by the simulation,
from where the head camera was measured to be. Where robot and ghost do not agree in the image, the
calibration is wrong, and so is the layout.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from duobench.core.backend import Image
from duobench.core.errors import RenderingError
from duobench.core.spatial import SE3
from duobench.core.types import SIDES, Array, DuoCommand
from duobench.core.video import jpeg
from duobench.real.rig import Rig
from duobench.tasks.task import Task
from duobench.world.robot.cameras import (
    CAMERAS,
    HEAD,
    MUJOCO_FROM_OPENCV,
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
)
from duobench.world.sim.layout import Layout
from duobench.world.sim.placement import first_valid
from duobench.world.sim.simulation import Simulation

if TYPE_CHECKING:
    from duobench.world.sim.rendering import Renderer

GHOST_OPACITY = 0.55
"""Opacity of the robot's ghost."""
_NEAREST_M = 0.05
"""Least distance from the camera's plane, in metres, of points that are projected."""


def project(points: Array, table_from_camera: SE3 = CAMERAS[HEAD].pose) -> Array:
    """Project points (n, 3) of the table frame, in metres, into a native image of the head camera.

    Args:
        points: The points.
        table_from_camera: Pose of the camera, with MuJoCo's axes.

    Returns:
        Pixels (n, 2) across and down, where the middle of the top left one is (0, 0); NaN for
        points behind the camera.
    """
    camera = (table_from_camera @ MUJOCO_FROM_OPENCV).inverse().apply(points)
    depth = np.where(camera[:, 2:] > _NEAREST_M, camera[:, 2:], np.nan)
    middle = np.array([(NATIVE_WIDTH - 1) / 2, (NATIVE_HEIGHT - 1) / 2])
    return CAMERAS[HEAD].focal * camera[:, :2] / depth + middle


class Overlay:
    """Layouts of a task, and images of them from the head camera of a rig.

    It compiles the task's model; OpenGL is not needed before the first image.
    """

    def __init__(self, task: Task, rig: Rig) -> None:
        self.task = task
        self._simulation = Simulation(task.props, robot=rig.robot)
        self._renderer: Renderer | None = None
        self.table_from_head = head_pose(rig)
        """Pose of the head camera in the table frame, with MuJoCo's axes."""
        camera = self._simulation.model.camera(HEAD)
        camera.pos[:] = self.table_from_head.translation
        camera.quat[:] = self.table_from_head.wxyz

    def layout(self, seed: int, split: str) -> Layout:
        """Sample the layout of a seed, as the simulated environment does."""
        sampled = first_valid(
            self._simulation, self.task.layouts(seed, split), self.task.id
        )
        return Layout.from_json(sampled.to_json())

    def images(self, layout: Layout, joints: Array) -> dict[str, bytes]:
        """Render the overlays for measured joints (2, 7); empty if images cannot be rendered.

        Returns:
            "layout", the whole scene as the head camera would see it, as JPEG; and "ghost", the
            robot alone on a transparent ground, as PNG.
        """
        simulation = self._simulation
        simulation.reset_data()
        simulation.duo.set_configuration(DuoCommand(joints=joints, openings=np.ones(2)))
        simulation.apply(layout)
        if self._renderer is None:
            from duobench.world.sim.rendering import Renderer

            self._renderer = Renderer(
                simulation.model, height=NATIVE_HEIGHT, width=NATIVE_WIDTH
            )
        try:
            image = self._renderer.render(simulation.data, HEAD)
            seen = self._renderer.segment(simulation.data, HEAD)
        except RenderingError:
            return {}  # the page shows outlines and numbers alone
        alpha = np.isin(seen, self._robot_geoms()) * round(255 * GHOST_OPACITY)
        return {
            "layout": jpeg(image),
            "ghost": _png(np.dstack([image, alpha.astype(np.uint8)])),
        }

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _robot_geoms(self) -> NDArray[np.intp]:
        model = self._simulation.model
        bodies = [model.body(int(number)).name for number in model.geom_bodyid]
        sides = tuple(f"{side}/" for side in SIDES)
        return np.flatnonzero([name.startswith(sides) for name in bodies])


def head_pose(rig: Rig) -> SE3:
    """Pose of a rig's head camera in the table frame, MuJoCo's axes; nominal if uncalibrated."""
    camera = rig.cameras.get(HEAD)
    if camera is None or camera.calibration is None:
        return CAMERAS[HEAD].pose
    return SE3.from_tquat(camera.calibration.pose) @ MUJOCO_FROM_OPENCV.inverse()


def _png(image: Image) -> bytes:
    buffer = io.BytesIO()
    Pillow.fromarray(image, "RGBA").save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()
