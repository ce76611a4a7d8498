"""Meshes of the scene: the robot's, and visual ones whose curves look round and edges sharp."""

import functools
import hashlib
import io
import math
from collections.abc import Mapping
from importlib import resources

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import AssetError, check_known
from duobench.core.types import Array
from duobench.world.objects.solid import Mesh, Texture
from duobench.world.robot.fr3_links import Link, Vector

FILE = "robot_meshes.npz"
"""The data, uncompressed, since wheels compress what they hold: `names` (k,), `counts` (k, 2) of
vertices and triangles, and one mesh after the other `points` (n, 3) on the grid and `faces` (m, 3).
"""
SHA256 = "b8ced2acb968ff971480e7dd368582c8547954e715020fc49b877c062a46f934"
"""Digest of the file: any other bytes are rejected: they are another robot."""
POINTS_PER_METRE = 100_000
"""Grid of the coordinates, which are kept as whole numbers."""

_ADVICE = "Install duobench again."


@functools.cache
def robot_meshes() -> Mapping[str, Mesh]:
    """Return all meshes by name, read once per process; their arrays are read-only."""
    return decode(shipped(FILE))


def shipped(file: str) -> bytes:
    """Return the bytes of a data file beside this module."""
    try:
        return resources.files("duobench.world.scene").joinpath(file).read_bytes()
    except OSError as error:
        raise AssetError(
            f"The meshes of the robot cannot be read ({error}). {_ADVICE}"
        ) from error


def check_intact(data: bytes, file: str, sha256: str) -> None:
    """Reject the bytes of a data file whose digest is another."""
    digest = hashlib.sha256(data).hexdigest()
    if digest != sha256:
        raise AssetError(
            f"The meshes of the robot are damaged: {file} has the SHA-256 {digest}, "
            f"expected {sha256}. {_ADVICE}"
        )


def decode(data: bytes) -> Mapping[str, Mesh]:
    """Return the meshes that the bytes of the data file hold."""
    check_intact(data, FILE, SHA256)
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        ends = file["counts"].cumsum(axis=0)[:-1]
        vertices = np.split(file["points"] / POINTS_PER_METRE, ends[:, 0])
        faces = np.split(file["faces"], ends[:, 1])
        names = file["names"].tolist()
    return dict(zip(names, map(Mesh, vertices, faces), strict=True))


def add_link(
    parent: mujoco.MjsBody,
    name: str,
    link: Link,
) -> mujoco.MjsBody:
    """Hang a link on a body, without its meshes; the robot's controller bears its weight."""
    body = parent.add_body(
        name=name,
        pos=link.position,
        quat=link.wxyz,
        gravcomp=1.0,
    )
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
    """Add one of the robot's meshes to a body, at a pose in its frame; the model has it once."""
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
    return body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, pos=position, quat=wxyz
    )


CREASE = math.radians(8.0)
"""Edges sharper than this look sharp; circles have 64 segments, so they look round."""
FLAT = math.radians(1.0)
"""Crease angle with which every face of a machined part looks flat."""

_TINY = 1e-300
_SAME = 1e-4
"""Normals that differ by less than this, in each component, are one."""


def corner_normals(
    vertices: Array, faces: NDArray[np.integer], crease: float = CREASE
) -> Array:
    """One unit normal for every corner of every triangle.

    A corner's normal is the mean over the triangles around its vertex that are turned by at most
    the crease angle against its own triangle. Each counts by its angle at the vertex, so that the
    result depends on the surface and not on how it was cut into triangles.

    From vertices (n, 3) and faces (m, 3), counter-clockwise from outside, with the largest angle in
    radians that looks round; normals (3 m, 3), triangle by triangle.
    """
    a = vertices[faces]
    onward = _unit(np.roll(a, -1, axis=1) - a)
    back = _unit(np.roll(a, 1, axis=1) - a)
    cosines = np.clip(np.einsum("fcx,fcx->fc", onward, back), -1.0, 1.0)
    # NumPy's own arc cosine differs in the last bit from one type of processor to the next.
    angles = np.array([math.acos(cosine) for cosine in cosines.ravel().tolist()])
    normals = _unit(np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0]))
    # Every pair of a corner and a corner of another triangle, or the same, at its vertex.
    corners = faces.ravel()
    by_vertex = np.argsort(corners, kind="stable")
    counts = np.bincount(corners, minlength=len(vertices))
    start = counts.cumsum() - counts
    pairs = counts[corners]
    one = np.repeat(np.arange(len(corners)), pairs)
    rank = np.arange(len(one)) - np.repeat(pairs.cumsum() - pairs, pairs)
    other = by_vertex[start[corners[one]] + rank]
    near = np.einsum("px,px->p", normals[one // 3], normals[other // 3]) >= math.cos(
        crease
    )
    one, other = one[near], other[near]
    total = np.zeros((len(corners), 3))
    np.add.at(total, one, normals[other // 3] * angles[other, None])
    return _unit(total)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), _TINY)


def add_visual_mesh(
    spec: mujoco.MjSpec,
    name: str,
    mesh: Mesh,
    crease: float = CREASE,
    texture: Texture | None = None,
) -> str:
    """Add a mesh with normals to a model under construction, and return its name.

    MuJoCo takes one normal a vertex, so a vertex on a sharp edge is there once for each side. The
    crease is the largest angle in radians between triangles that looks round. With a texture, a
    texture and a material of the same name are added too.
    """
    vertices, faces = mesh.vertices, mesh.faces
    normals = corner_normals(vertices, faces, crease)
    keys = np.column_stack([faces.ravel(), np.rint(normals / _SAME)])
    if texture is not None:
        keys = np.column_stack([keys, texture.corners])
    _, first, corners = np.unique(
        keys,
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    added = spec.add_mesh(
        name=name,
        uservert=vertices[faces.ravel()[first]].ravel(),
        usernormal=normals[first].ravel(),
        userface=corners.ravel().astype(np.int32),
        # It carries no mass, so it may be open.
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    if texture is not None:
        added.usertexcoord = texture.corners[first].ravel()
        added.userfacetexcoord = added.userface
        add_texture(spec, name, texture.texels)
    return name


def add_texture(spec: mujoco.MjSpec, name: str, texels: NDArray[np.uint8]) -> None:
    """Add a flat texture (height, width, 3) to a model, and a material of its name that has it."""
    spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        height=texels.shape[0],
        width=texels.shape[1],
        nchannel=3,
        data=texels.ravel().tolist(),
    )
    material = spec.add_material(name=name)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
