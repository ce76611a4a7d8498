"""Compose the whole model: options, workcell, robot, cameras, and a task's props."""

from collections.abc import Iterable

import manifold3d
import mujoco
import numpy as np

from duobench.core.errors import DuoBenchError, TaskError
from duobench.core.types import CONTROL_HZ
from duobench.world.objects.prop import Hinge, Prop
from duobench.world.objects.shapes import Shape, ShapeKind, at_height
from duobench.world.objects.solid import (
    Image,
    Mesh,
    Solid,
    images_of,
    manifold_from,
    mass_properties,
)
from duobench.world.robot.cameras import (
    NATIVE_HEIGHT,
    NATIVE_WIDTH,
    OVERVIEW_VIEW,
    View,
)
from duobench.world.robot.frames import ROBOT, Robot
from duobench.world.robot.workcell import (
    FLOOR_Z,
    ROOM_HEIGHT,
    ROOM_X,
    ROOM_Y,
)
from duobench.world.scene.arms import add_robot
from duobench.world.scene.cameras import add_cameras, add_overview_camera
from duobench.world.scene.meshes import add_visual_mesh
from duobench.world.scene.surfaces import (
    COLLISION_GEOM_GROUP,
    CONTACT_SOLIMP,
    CONTACT_SOLREF,
    VISUAL_GEOM_GROUP,
    CollisionGroup,
    collide_as,
    stiffen,
    visual_only,
)
from duobench.world.scene.workcell import add_workcell

SUBSTEPS = 16
"""Physics steps in one control step."""
_OPTIONS = f"""
<mujoco model="duobench">
  <compiler angle="radian"/>
  <!-- For contacts and constraints; twenty marbles in a cup need about a tenth of it. -->
  <size memory="32M"/>
  <!-- Elliptic cones with a high impedance ratio keep grasped objects from creeping out of the
       pads; they are also what the published gripper model asks for. -->
  <option timestep="{1.0 / (CONTROL_HZ * SUBSTEPS)!r}" integrator="implicitfast" cone="elliptic"
          impratio="10">
    <!-- A diverged simulation must be reported, not silently reset by the engine. -->
    <flag autoreset="disable"/>
  </option>
  <!-- Centre and radius (metres) of what lights and shadows must cover; fixed, so that the image
       does not depend on a task's objects. -->
  <statistic center="0.4 0 0.1" extent="1.4"/>
  <visual>
    <!-- Of the offscreen buffer, large enough for a native image. -->
    <global offwidth="{NATIVE_WIDTH}" offheight="{NATIVE_HEIGHT}"/>
    <!-- The reach is half the side of the shadow map as a share of the extent: table and arms. With
         the size in texels, 2.5 mm a texel, about a pixel of a square wrist image. Rendering the
         map is the slowest part of an image on a processor. -->
    <map znear="0.01" zfar="5" shadowclip="0.62"/>
    <!-- Lights are far away and highlights soft, so one quad a side looks the same as many. Balls
         have 120 triangles: twenty marbles must not cost as much as the robot. -->
    <quality shadowsize="704" offsamples="0" numquads="1" numslices="12" numstacks="6"/>
    <headlight ambient="0.43 0.43 0.44" diffuse="0 0 0" specular="0 0 0"/>
  </visual>
</mujoco>
"""


def compose(
    props: Iterable[Prop] = (),
    overview: View = OVERVIEW_VIEW,
    robot: Robot = ROBOT,
) -> mujoco.MjSpec:
    """The model's specification with a task's objects, each of which has a unique name.

    The camera for people has the given view. Body, joint and geom names are those of `scene.naming`
    and of the props.
    """
    _check_in_room(overview)
    spec = mujoco.MjSpec.from_string(_OPTIONS)
    add_workcell(spec, robot.mount)
    add_robot(spec, robot)
    add_cameras(spec.worldbody, robot.gripper)
    add_overview_camera(spec.worldbody, overview)
    names = {body.name for body in spec.bodies}
    for prop in props:
        for name in (prop.name, *(prop.part_name(part.name) for part in prop.parts)):
            if name in names:
                raise TaskError(
                    f"Two bodies of the scene are called {name!r}; give each prop, and each part "
                    "of one, its own name."
                )
            names.add(name)
        add_prop(spec, prop)
    return spec


def _check_in_room(view: View) -> None:
    """Reject an eye outside: walls and ceiling would be visible from behind, or not at all."""
    room = {"x": ROOM_X, "y": ROOM_Y, "z": (FLOOR_Z, FLOOR_Z + ROOM_HEIGHT)}
    if not all(
        low < at < high for at, (low, high) in zip(view.eye, room.values(), strict=True)
    ):
        ends = ", ".join(
            f"{axis} {low:.2f} to {high:.2f}" for axis, (low, high) in room.items()
        )
        raise DuoBenchError(
            f"A camera for people stands inside the room ({ends} m); the eye {view.eye} does not."
        )


_RENDERED_WELL = (ShapeKind.BOX, ShapeKind.SPHERE)
"""Shapes that are rendered as they collide. MuJoCo smears the edges of a hull, and gives a cylinder
more triangles than a rounder mesh has."""

RIB_HEIGHT = 0.0015
"""Height in metres above a floor of the level face in the walls around it. Measured on bowls and
cups at all yaws: it leaves a seventh of the leaks, and 1 mm or 2.5 mm would leave a fourth."""

_LEVEL = 0.999
"""A normal with a larger upward component belongs to a floor."""
_MOST_FLOORS = 100
"""Most heights of floors; a mesh with more of them is round, not terraced."""
_DIGITS = 6
"""Digits after the point, in metres, to which the height of a floor counts."""


def add_prop(spec: mujoco.MjSpec, prop: Prop) -> None:
    """Add a prop: free on the table, or, where fixed, a body that only a layout moves."""
    root = spec.worldbody.add_body(name=prop.name, mocap=prop.fixed)
    if not prop.fixed:
        root.add_freejoint(name=prop.name)
    group = CollisionGroup.FIXTURE if prop.fixed else CollisionGroup.OBJECT
    _fill(spec, root, prop.solid, group)
    for part in prop.parts:
        name = prop.part_name(part.name)
        body = root.add_body(name=name, pos=part.pose.translation, quat=part.pose.wxyz)
        if part.hinge is not None:
            _add_hinge(body, name, part.hinge)
        _fill(spec, body, part.solid, CollisionGroup.OBJECT if part.hinge else group)
    shapes = len(prop.solid.shapes)
    images = max(len(root.geoms) - shapes, 1)
    for value, variant in prop.variants.items():
        if {*variant.without_shapes} - {*range(shapes)} or (
            {*variant.without_images} - {*range(images)}
        ):
            raise TaskError(
                f"Variant {value!r} of {prop.name!r} leaves out shapes "
                f"{sorted(variant.without_shapes)} and images {sorted(variant.without_images)}; "
                f"counted from 0, there are {shapes} shapes and {images} images."
            )


def _add_hinge(
    body: mujoco.MjsBody,
    name: str,
    hinge: Hinge,
) -> None:
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
    spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid, group: CollisionGroup
) -> None:
    properties = mass_properties(solid)
    body.explicitinertial = True
    body.mass = properties.mass
    body.ipos = properties.centre
    i = properties.inertia
    body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    kinds = [shape.kind for shape in solid.shapes]
    rendered_alone = (
        solid.mesh is None
        and not solid.images
        and len(kinds) == 1
        and kinds[0] in _RENDERED_WELL
    )
    for number, shape in enumerate(solid.shapes):
        geom = _add_shape(spec, body, f"{body.name}:{number}", shape)
        geom.rgba, geom.friction = shape.rgba or solid.rgba, solid.friction
        geom.condim = solid.condim
        stiffen(geom)
        geom.group = VISUAL_GEOM_GROUP if rendered_alone else COLLISION_GEOM_GROUP
        collide_as(geom, group)
    if not rendered_alone:
        for number, image in enumerate(_images(solid)):
            name = f"{body.name}:image{number}"
            is_ribbed = image.shadow and image.texture is None
            mesh = add_ribs(image.mesh) if is_ribbed else image.mesh
            add_visual_mesh(spec, name, mesh, texture=image.texture)
            geom = body.add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name
            )
            geom.rgba = image.rgba
            if image.texture is not None:
                geom.material = name
            visual_only(geom, shadow=image.shadow)


def _images(solid: Solid) -> tuple[Image, ...]:
    if solid.images:
        return solid.images
    if solid.mesh is not None:
        return (Image(mesh=solid.mesh, rgba=solid.rgba),)
    return images_of(solid.shapes, solid.rgba)


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
    by 2 mm only. Inside the wall it is invisible, and light for the seam has to pass it.
    """
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = across[:, 2] > _LEVEL * np.linalg.norm(across, axis=1)
    # Nothing stands on the highest one.
    floors = np.unique(corners[level, 0, 2].round(_DIGITS))[:-1]
    if len(floors) > _MOST_FLOORS:
        return mesh
    solid = manifold_from(mesh)
    vertices = [mesh.vertices]
    faces = [mesh.faces]
    count = len(mesh.vertices)
    for height in (floors + RIB_HEIGHT).tolist():
        section = solid.slice(height).to_polygons()
        if not section:
            continue
        points = np.vstack(section)
        vertices.append(at_height(points, height))
        faces.append(
            np.asarray(manifold3d.triangulate(section), dtype=np.int32) + count
        )
        count += len(points)
    return Mesh(vertices=np.vstack(vertices), faces=np.vstack(faces))
