"""Links of the robot in a model: bodies with their mass, and meshes."""

from __future__ import annotations

import mujoco

from duobench.errors import check_known
from duobench.robot.fr3_links import Link, Vector
from duobench.scene.robot.meshes import robot_meshes


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
    """Add one of the robot's meshes to a body, at a pose in its frame; the model has it once.

    Raises:
        UnknownNameError: There is no such mesh.
        AssetError: The data file is missing or damaged.
    """
    meshes = robot_meshes()
    check_known("mesh of the robot", mesh, meshes)
    if spec.mesh(mesh) is None:
        spec.add_mesh(
            name=mesh,
            uservert=meshes[mesh].vertices.ravel(),
            userface=meshes[mesh].faces.ravel(),
            # Reduced meshes need not be watertight; none of them carries mass.
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, pos=position, quat=wxyz)
