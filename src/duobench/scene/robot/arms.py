"""The FR3 Duo: two arms, two grippers, two wrist cameras."""

from __future__ import annotations

import mujoco

from duobench.robot.frames import FLANGE_OFFSET, LINK7_FROM_FLANGE, LINK7_FROM_TCP
from duobench.scene.cameras import add_wrist_camera
from duobench.scene.naming import flange_name, tcp_name
from duobench.scene.robot import fr3, robotiq
from duobench.types import SIDES, Side


def add_robot(spec: mujoco.MjSpec) -> None:
    """Add both arms with grippers and wrist cameras to a model under construction."""
    for side in SIDES:
        bodies = _add_kinematics(spec, side)
        fr3.add_geometry(spec, side, bodies)
        robotiq.add_gripper(spec, side, bodies[-1], FLANGE_OFFSET)
        add_wrist_camera(bodies[-1], LINK7_FROM_FLANGE, side)


def kinematic_model(side: Side) -> mujoco.MjModel:
    """One arm alone: 7 joints, flange and tool sites, no geometry, no gripper.

    Inverse kinematics solves on this model, so its cost does not grow with the scene.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    _add_kinematics(spec, side)
    return spec.compile()


def _add_kinematics(spec: mujoco.MjSpec, side: Side) -> list[mujoco.MjsBody]:
    """Add one arm without any geometry, with its sites, and return its links."""
    bodies = fr3.add_kinematics(spec, side)
    for name, pose in ((flange_name(side), LINK7_FROM_FLANGE), (tcp_name(side), LINK7_FROM_TCP)):
        bodies[-1].add_site(name=name, pos=pose.translation, size=[0.001] * 3, group=4)
    return bodies
