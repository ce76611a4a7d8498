"""Links of the robot in a model: bodies with their mass, and meshes."""

from __future__ import annotations

import mujoco

from duobench.scene.fr3_links import Link, Vector
from duobench.scene.meshes import add_robot_mesh


def add_link(parent: mujoco.MjsBody, name: str, link: Link) -> mujoco.MjsBody:
    """Hang a link on a body, without its meshes; the robot's controller bears its weight."""
    body = parent.add_body(name=name, pos=link.position, quat=link.wxyz, gravcomp=1.0)
    if link.mass is not None:
        body.explicitinertial = True
        body.mass, body.ipos = link.mass, link.centre
        body.iquat, body.inertia = link.axes_wxyz, link.inertia
    return body


def add_mesh(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    mesh: str,
    position: Vector = (0.0, 0.0, 0.0),
    wxyz: Vector = (1.0, 0.0, 0.0, 0.0),
) -> mujoco.MjsGeom:
    """Add one of the robot's meshes to a body, at a pose in its frame."""
    return body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=add_robot_mesh(spec, mesh),
        pos=position,
        quat=wxyz,
    )
