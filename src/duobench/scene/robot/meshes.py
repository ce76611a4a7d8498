"""Links of the arms and grippers in a model: bodies with their mass, and meshes.

All 38 meshes, reduced for images and convex hulls for contacts, are in one file beside this module,
made from the published models by the recipes of `dev/tools/meshes.py`. Their names end in ":visual"
or ":hull", such as "fr3/link1:hull".
"""

from __future__ import annotations

import functools
import hashlib
import io
from collections.abc import Mapping
from importlib import resources

import mujoco
import numpy as np

from duobench.errors import AssetError, check_known
from duobench.objects.solid import Mesh
from duobench.robot.fr3_links import Link, Vector

FILE = "robot_meshes.npz"
"""The data, uncompressed, since wheels compress what they hold: `names` (k,), `counts` (k, 2) of
vertices and triangles, and one mesh after the other `points` (n, 3) on the grid and `faces` (m, 3).
"""
SHA256 = "485c87be44e231ad27eb7e0bb349f7de128cfac48f59821f65245509ccc70b1e"
"""Digest of the file: any other bytes are rejected, so that nobody simulates another robot."""
POINTS_PER_METRE = 100_000
"""Grid of the coordinates, which are kept as whole numbers."""

_ADVICE = "Install duobench again."


@functools.cache
def robot_meshes() -> Mapping[str, Mesh]:
    """Return all meshes by name, read once per process; their arrays are read-only.

    Raises:
        AssetError: The data file is missing or damaged.
    """
    try:
        data = resources.files("duobench.scene.robot").joinpath(FILE).read_bytes()
    except OSError as error:
        raise AssetError(f"The meshes of the robot cannot be read ({error}). {_ADVICE}") from error
    return decode(data)


def decode(data: bytes) -> Mapping[str, Mesh]:
    """Return the meshes that the bytes of the data file hold.

    Raises:
        AssetError: The bytes are not those of the file.
    """
    digest = hashlib.sha256(data).hexdigest()
    if digest != SHA256:
        raise AssetError(
            f"The meshes of the robot are damaged: {FILE} has the SHA-256 {digest}, "
            f"expected {SHA256}. {_ADVICE}"
        )
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        ends = file["counts"].cumsum(axis=0)[:-1]
        vertices = np.split(file["points"] / POINTS_PER_METRE, ends[:, 0])
        faces = np.split(file["faces"], ends[:, 1])
        names = file["names"].tolist()
    return dict(zip(names, map(Mesh, vertices, faces), strict=True))


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
