"""Links of the robot in a model: bodies with their mass, images, and hulls that collide."""

from __future__ import annotations

import mujoco

from duobench.scene.filters import COLLISION_GEOM_GROUP, Group, visual_only
from duobench.scene.fr3_links import Link, Vector
from duobench.scene.meshes import add_robot_mesh
from duobench.scene.surfaces import collide_as_metal

_ORIGIN = (0.0, 0.0, 0.0)
_UNTURNED = (1.0, 0.0, 0.0, 0.0)


def add_link(parent: mujoco.MjsBody, name: str, link: Link) -> mujoco.MjsBody:
    """Hang a link on a body, without its images; a controller bears its weight."""
    body = parent.add_body(name=name, pos=link.position, quat=link.wxyz, gravcomp=1.0)
    if link.mass is not None:
        body.explicitinertial = True
        body.mass, body.ipos = link.mass, link.centre
        body.iquat, body.inertia = link.axes_wxyz, link.inertia
    return body


def add_image(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    mesh: str,
    rgba: Vector,
    *,
    position: Vector = _ORIGIN,
    wxyz: Vector = _UNTURNED,
    shadow: bool = True,
) -> None:
    """Show a mesh of the robot, named without its ":visual", at a pose in a body's frame."""
    geom = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=add_robot_mesh(spec, f"{mesh}:visual"),
        pos=position,
        quat=wxyz,
        rgba=rgba,
    )
    visual_only(geom, shadow=shadow)


def add_hull(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    mesh: str,
    group: Group,
    *,
    name: str = "",
    position: Vector = _ORIGIN,
    wxyz: Vector = _UNTURNED,
) -> None:
    """Let a body collide as a mesh of the robot, named without its ":hull"."""
    geom = body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=add_robot_mesh(spec, f"{mesh}:hull"),
        pos=position,
        quat=wxyz,
        density=0.0,
        group=COLLISION_GEOM_GROUP,
    )
    collide_as_metal(geom, group)
