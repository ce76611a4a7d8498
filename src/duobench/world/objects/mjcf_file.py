"""Objects from files of MuJoCo: one top body in MJCF, with hinged bodies as its parts.

MuJoCo reads the file, with its defaults, assets and masses, and its compiled bodies become solids,
which collide and are rendered as other props. Of contact parameters the file decides friction and
condim, where they are not MuJoCo's own. What would change the world around the object is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from duobench.core.errors import AssetError, TaskError
from duobench.core.spatial import SE3, product
from duobench.core.types import Array
from duobench.world.objects.mesh_file import (
    MOST_TRIANGLES,
    check_size,
    found,
)
from duobench.world.objects.prop import Hinge, Part, Prop
from duobench.world.objects.shapes import (
    Colour,
    Shape,
    box,
    cylinder,
    hull,
    sphere,
)
from duobench.world.objects.solid import (
    PLASTIC_FRICTION,
    Image,
    MassProperties,
    Mesh,
    Solid,
    Texture,
    corner_points,
    hull_of,
    images_of,
    mesh_of,
)

if TYPE_CHECKING:
    import mujoco

_REFUSED = (
    "cameras",
    "lights",
    "actuators",
    "sensors",
    "tendons",
    "equalities",
    "pairs",
    "excludes",
    "keys",
    "skins",
    "flexes",
    "hfields",
    "plugins",
)
"""Elements that belong to a scene, or to what no prop has."""
_SHAPES = {2: "sphere", 3: "capsule", 5: "cylinder", 6: "box", 7: "mesh"}
"""Types of geoms that are shapes of solids [MuJoCo's mjtGeom]."""
_HINGE = 3
"""Type of a hinge [MuJoCo's mjtJoint]."""
_RENDERED = 2
"""Geom groups up to this one are rendered [MuJoCo]."""
_COLOUR = (0.5, 0.5, 0.5, 1.0)
"""Colour of a geom that has none of its own, so that its material's counts [MuJoCo]."""
_FRICTION = (1.0, 0.005, 0.0001)
"""Friction of a geom that has none of its own [MuJoCo]."""


def mjcf_object(
    file: str | Path, *, name: str | None = None, fixed: bool = False
) -> Prop:
    """Return an object made of the one top body of an MJCF file, in its frame.

    Bodies with a hinge become parts, named as they are; bodies without a joint belong to the one
    that carries them. The pose of the top body, sites and a free joint make no difference.

    Args:
        file: XML file; a relative path begins in the folder of the calling module, and paths in the
            file as MuJoCo says.
        name: Name of the object; the file's without its ending by default.
        fixed: Whether it stands still wherever the layout puts it.

    Raises:
        TaskError: The file describes what no prop is.
        AssetError: There is no such file, or MuJoCo cannot read it.
    """
    import mujoco

    path = found(file, (".xml", ".mjcf"))
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _check(path, _scene(spec))
        (top,) = spec.worldbody.bodies
        if not top.joints:
            top.add_freejoint()
        spec.compiler.fusestatic = True
        model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise AssetError(f"MuJoCo cannot read {path}: {reason}.") from error
    _check(path, _bodies(model))
    bodies = range(1, model.nbody)
    root, *solids = (_solid(model, body) for body in bodies)
    mass = float(model.body_mass.sum())
    check_size(
        path, np.vstack([corner_points(solid) for solid in (root, *solids)]), mass
    )
    parts = [
        _part(model, body, solid)
        for body, solid in zip(bodies[1:], solids, strict=True)
    ]
    return Prop(name=name or path.stem, solid=root, parts=tuple(parts), fixed=fixed)


def _check(file: Path, reasons: Iterable[str]) -> None:
    for reason in reasons:
        raise TaskError(f"{file.name} is no object of a task: {reason}.")


def _scene(spec: mujoco.MjSpec) -> Iterator[str]:
    """Reasons why a file is not that of one object."""
    import mujoco

    tops, geoms = spec.worldbody.bodies, spec.worldbody.geoms
    if len(tops) != 1 or geoms:
        yield f"its world has {len(tops)} bodies and {len(geoms)} geoms, instead of one body"
    for kind in _REFUSED:
        if getattr(spec, kind):
            yield f"it has {kind}; remove them"
    usual = mujoco.MjSpec().option
    for key in (key for key in dir(usual) if not key.startswith("_")):
        if not np.array_equal(getattr(spec.option, key), getattr(usual, key)):
            yield f"its option sets {key}, which the benchmark decides; remove it"
    for body in spec.bodies:
        if body.mocap or body.gravcomp:
            yield f"its body {body.name!r} has mocap or gravcomp; remove it"
    if any(joint.type != mujoco.mjtJoint.mjJNT_FREE for joint in tops[0].joints):
        yield "its top body has a joint that is not free"


def _bodies(model: mujoco.MjModel) -> Iterator[str]:
    """Reasons why compiled bodies are no parts of a prop."""
    if model.nmeshface > MOST_TRIANGLES:
        yield f"it has {model.nmeshface} triangles, more than {MOST_TRIANGLES}"
    for number in range(1, model.nbody):
        name, geoms = model.body(number).name, _geoms(model, number)
        surfaces = {(*geom.friction, *geom.condim) for geom in geoms if _is_felt(geom)}
        if any(geom.type[0] not in _SHAPES for geom in geoms) or len(surfaces) != 1:
            yield (
                f"the geoms of its body {name!r} should be {', '.join(_SHAPES.values())}, and "
                "those that collide, at least one, have one friction and condim"
            )
    for number in range(2, model.nbody):
        body, joint = model.body(number), model.joint(model.body_jntadr[number])
        if not body.name or body.parentid[0] != 1:
            yield f"its body {body.name!r} has no name, or hangs on another than the top body"
        lost = (joint.frictionloss, joint.armature, joint.qpos0, joint.qpos_spring)
        if (body.jntnum[0], joint.type[0]) != (1, _HINGE) or any(map(np.any, lost)):
            yield (
                f"its body {body.name!r} moves otherwise than on one hinge with a range, "
                "stiffness and damping, and without frictionloss, armature, ref and springref"
            )
        if not model.jnt_limited[joint.id]:
            yield f"the hinge of its body {body.name!r} has no range"


def _geoms(model: mujoco.MjModel, body: int) -> list[Any]:
    first = model.body_geomadr[body]
    return [model.geom(first + number) for number in range(model.body_geomnum[body])]


def _is_felt(geom: Any) -> bool:
    return bool(geom.contype[0] or geom.conaffinity[0])


def _part(model: mujoco.MjModel, number: int, solid: Solid) -> Part:
    """A body with a hinge; the part's frame is the body's, moved onto its axis."""
    body, joint = model.body(number), model.joint(model.body_jntadr[number])
    x, y, z = joint.axis.tolist()
    low, high = joint.range.tolist()
    return Part(
        name=body.name,
        solid=solid,
        pose=SE3.from_wxyz(body.quat, body.pos) @ SE3.at(*joint.pos),
        hinge=Hinge(
            axis=(x, y, z),
            limits=(low, high),
            stiffness=float(joint.stiffness[0]),
            damping=float(joint.damping[0]),
        ),
    )


def _solid(model: mujoco.MjModel, number: int) -> Solid:
    body, anchor = model.body(number), model.jnt_pos[model.body_jntadr[number]]
    geoms = _geoms(model, number)
    felt = [geom for geom in geoms if _is_felt(geom)]
    rendered = [geom for geom in geoms if geom.group[0] <= _RENDERED] or felt
    meshes = [geom for geom in rendered if geom.dataid[0] >= 0]
    plain = (_shapes(model, geom, anchor) for geom in rendered if geom.dataid[0] < 0)
    images = images_of((shape for shapes in plain for shape in shapes), _COLOUR)
    turn = SE3.from_wxyz(body.iquat).rotation
    slide, torsion, rolling = felt[0].friction.tolist()
    if (slide, torsion, rolling) == _FRICTION:
        slide = PLASTIC_FRICTION
    return Solid(
        shapes=tuple(shape for geom in felt for shape in _shapes(model, geom, anchor)),
        rgba=_colour(model, rendered[0]),
        images=(*images, *(_image(model, geom, anchor) for geom in meshes)),
        inertial=MassProperties(
            mass=float(body.mass[0]),
            centre=body.ipos - anchor,
            inertia=product(turn * body.inertia, turn.T),
        ),
        friction=(slide, torsion, rolling),
        condim=int(felt[0].condim[0]),
    )


def _shapes(model: mujoco.MjModel, geom: Any, anchor: Array) -> tuple[Shape, ...]:
    """The shapes of a geom, as MuJoCo collides it: of a mesh the hull."""
    kind, rgba = _SHAPES[int(geom.type[0])], _colour(model, geom)
    at = SE3.from_wxyz(geom.quat, geom.pos - anchor)
    a, b, c = geom.size.tolist()
    if kind == "box":
        return (box(2 * a, 2 * b, 2 * c, at=at, rgba=rgba),)
    if kind == "sphere":
        return (sphere(a, at=at, rgba=rgba),)
    if kind == "mesh":
        corners = mesh_of(hull_of(_mesh(model, geom).vertices)).vertices
        return (hull(corners.tolist(), at=at, rgba=rgba),)
    rod = cylinder(a, 2 * b, at=at, rgba=rgba)
    if kind == "cylinder":
        return (rod,)
    low, high = (sphere(a, at=at @ SE3.at(z=z), rgba=rgba) for z in (-b, b))
    return rod, low, high


def _mesh(model: mujoco.MjModel, geom: Any) -> Mesh:
    """The mesh of a geom, in its frame."""
    mesh = model.mesh(geom.dataid[0])
    vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
    faces = model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]
    return Mesh(vertices.astype(np.float64), faces.copy())


def _colour(model: mujoco.MjModel, geom: Any) -> Colour:
    own, material = geom.rgba.tolist(), int(geom.matid[0])
    if material >= 0 and tuple(own) == _COLOUR:
        own = model.mat_rgba[material].tolist()
    red, green, blue, opacity = own
    return red, green, blue, opacity


def _image(model: mujoco.MjModel, geom: Any, anchor: Array) -> Image:
    mesh = _mesh(model, geom)
    at = SE3.from_wxyz(geom.quat, geom.pos - anchor)
    return Image(
        mesh=Mesh(at.apply(mesh.vertices), mesh.faces),
        rgba=_colour(model, geom),
        texture=_texture(model, geom),
    )


def _texture(model: mujoco.MjModel, geom: Any) -> Texture | None:
    """The texture of a geom's mesh, without opacity; None where it is not flat."""
    import mujoco

    mesh, material = model.mesh(geom.dataid[0]), int(geom.matid[0])
    role, flat = mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTexture.mjTEXTURE_2D
    number = -1 if material < 0 else int(model.mat_texid[material, role])
    if number < 0 or mesh.texcoordadr[0] < 0 or model.tex_type[number] != flat:
        return None
    texture = model.texture(number)
    shape = int(texture.height[0]), int(texture.width[0]), int(texture.nchannel[0])
    texels = model.tex_data[texture.adr[0] :][: math.prod(shape)].reshape(shape)
    rows = model.mesh_facetexcoord[mesh.faceadr[0] :][: mesh.facenum[0]].ravel()
    channels = (0, 0, 0) if shape[2] == 1 else (0, 1, 2)
    return Texture(
        texels=texels[..., channels],
        corners=model.mesh_texcoord[mesh.texcoordadr[0] + rows],
    )
