"""A task's props as bodies of the model."""

from __future__ import annotations

import manifold3d
import mujoco
import numpy as np

from duobench.objects.prop import Hinge, Prop
from duobench.objects.shapes import Shape, ShapeKind, at_height
from duobench.objects.solid import Image, Mesh, Solid, images_of, manifold_from, mass_properties
from duobench.scene.filters import (
    COLLISION_GEOM_GROUP,
    VISUAL_GEOM_GROUP,
    Group,
    collide_as,
    visual_only,
)
from duobench.scene.mesh_normals import add_visual_mesh
from duobench.scene.surfaces import CONTACT_SOLIMP, CONTACT_SOLREF, stiffen

_RENDERED_WELL = (ShapeKind.BOX, ShapeKind.SPHERE)
"""Shapes that are rendered as they collide. MuJoCo smears the edges of a hull, and gives a cylinder
more triangles than a rounder mesh has."""

RIB_HEIGHT = 0.0015
"""Height in metres above a floor of the level face in the walls around it. Measured on bowls and
cups at all yaws: it leaves a seventh of the leaks, and 1 mm or 2.5 mm would leave a fourth."""

_LEVEL = 0.999
"""A normal with a larger upward component belongs to a floor."""
_SAME = 6
"""Digits after the point, in metres, to which the height of a floor counts."""


def add_prop(spec: mujoco.MjSpec, prop: Prop) -> None:
    """Add a prop: free on the table, or, where fixed, a body that only a layout moves."""
    root = spec.worldbody.add_body(name=prop.name, mocap=prop.fixed)
    if not prop.fixed:
        root.add_freejoint(name=prop.name)
    _fill(spec, root, prop.solid, prop)
    for part in prop.parts:
        name = prop.part_name(part.name)
        body = root.add_body(name=name, pos=part.pose.translation, quat=part.pose.wxyz)
        if part.hinge is not None:
            _add_hinge(body, name, part.hinge)
        _fill(spec, body, part.solid, prop, moving=part.hinge is not None)


def _add_hinge(body: mujoco.MjsBody, name: str, hinge: Hinge) -> None:
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=hinge.axis,
        range=hinge.limits,
        limited=True,
        solref_limit=CONTACT_SOLREF,
        solimp_limit=CONTACT_SOLIMP,
        stiffness=[hinge.stiffness, 0, 0],
        damping=[hinge.damping, 0, 0],
    )


def _fill(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid, prop: Prop, *, moving: bool = False
) -> None:
    """Give a body its mass, its collision shapes and its image."""
    properties = mass_properties(solid)
    body.explicitinertial = True
    body.mass = properties.mass
    body.ipos = properties.centre
    i = properties.inertia
    body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    group = Group.FIXTURE if prop.fixed and not moving else Group.OBJECT
    kinds = [shape.kind for shape in solid.shapes]
    rendered_alone = solid.mesh is None and len(kinds) == 1 and kinds[0] in _RENDERED_WELL
    for number, shape in enumerate(solid.shapes):
        geom = _add_shape(spec, body, f"{body.name}:{number}", shape)
        geom.rgba = shape.rgba or solid.rgba
        geom.friction = solid.friction
        geom.condim = solid.condim
        stiffen(geom)
        geom.group = VISUAL_GEOM_GROUP if rendered_alone else COLLISION_GEOM_GROUP
        collide_as(geom, group)
    if not rendered_alone:
        for number, image in enumerate(_images(solid)):
            _add_image(spec, body, f"{body.name}:image{number}", image)


def _images(solid: Solid) -> tuple[Image, ...]:
    if solid.images:
        return solid.images
    if solid.mesh is not None:
        return (Image(mesh=solid.mesh, rgba=solid.rgba),)
    return images_of(solid.shapes, solid.rgba)


def _add_image(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, image: Image) -> None:
    mesh = add_ribs(image.mesh) if image.shadow else image.mesh
    geom = body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=add_visual_mesh(spec, name, mesh),
        rgba=image.rgba,
    )
    visual_only(geom, shadow=image.shadow)


def _add_shape(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, shape: Shape
) -> mujoco.MjsGeom:
    geom = body.add_geom(name=name, pos=shape.pose.translation, quat=shape.pose.wxyz)
    if shape.kind is ShapeKind.BOX:
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_BOX, np.array(shape.size) / 2
    elif shape.kind is ShapeKind.CYLINDER:
        radius, height = shape.size
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_CYLINDER, (radius, height / 2, 0.0)
    elif shape.kind is ShapeKind.SPHERE:
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, (*shape.size, 0.0, 0.0)
    else:
        spec.add_mesh(name=name, uservert=np.array(shape.points).ravel())
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, name
    return geom


def add_ribs(mesh: Mesh) -> Mesh:
    """The mesh of a solid with a level face inside its walls just above each of its floors.

    No light then comes through the seam between a wall and the floor beside it. MuJoCo moves every
    face of the shadow map away from the light by one and a half texels times the face's slope, so
    that no surface lies in its own shadow. A wall that runs along the light is so steep that it
    moves by centimetres, to beyond the floor: its seam is lit, in bright dashes. A level face moves
    by 2 mm only. Inside the wall nobody sees it, and light for the seam has to pass it.
    """
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = across[:, 2] > _LEVEL * np.linalg.norm(across, axis=1)
    # Nothing stands on the highest one.
    floors = np.unique(corners[level, 0, 2].round(_SAME))[:-1]
    solid = manifold_from(mesh)
    vertices, faces, count = [mesh.vertices], [mesh.faces], len(mesh.vertices)
    for height in (floors + RIB_HEIGHT).tolist():
        section = solid.slice(height).to_polygons()
        if not section:
            continue
        points = np.vstack(section)
        vertices.append(at_height(points, height))
        faces.append(np.asarray(manifold3d.triangulate(section), dtype=np.int32) + count)
        count += len(points)
    return Mesh(vertices=np.vstack(vertices), faces=np.vstack(faces))
