"""The FR3 Duo: two arms, two grippers, two wrist cameras."""

from __future__ import annotations

import mujoco
import numpy as np

from duobench.scene import fr3, robotiq
from duobench.scene.cameras import add_wrist_camera
from duobench.scene.naming import tcp_name
from duobench.spatial import SE3
from duobench.types import SIDES, Side

LINK7_FROM_FLANGE = SE3(np.eye(3), np.array([0.0, 0.0, fr3.FLANGE_OFFSET]))
"""Pose of the flange in link 7."""
LINK7_FROM_TCP = SE3(np.eye(3), np.array([0.0, 0.0, fr3.FLANGE_OFFSET + robotiq.TCP_OFFSET]))
"""Pose of the tool centre point in link 7; both have the same orientation."""


def add_robot(spec: mujoco.MjSpec) -> None:
    """Add both arms with grippers and wrist cameras to a model under construction."""
    for side in SIDES:
        bodies = fr3.add_kinematics(spec, side)
        fr3.add_geometry(spec, side, bodies)
        flange = bodies[-1]
        robotiq.add_gripper(spec, side, flange, fr3.FLANGE_OFFSET)
        add_wrist_camera(flange, LINK7_FROM_FLANGE, side)
        flange.add_site(
            name=tcp_name(side), pos=LINK7_FROM_TCP.translation, size=[0.001] * 3, group=4
        )


def kinematic_model(side: Side) -> mujoco.MjModel:
    """One arm alone: 7 joints, flange and tool sites, no geometry, no gripper.

    Inverse kinematics solves on this model, so its cost does not grow with the scene.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    flange = fr3.add_kinematics(spec, side)[-1]
    flange.add_site(name=tcp_name(side), pos=LINK7_FROM_TCP.translation, size=[0.001] * 3, group=4)
    return spec.compile()
