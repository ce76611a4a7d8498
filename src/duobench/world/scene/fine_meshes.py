"""Finer images of the robot, for renderers that show how a surface takes the light.

They take the place of the reduced meshes of `scene.meshes` in a picture and nowhere else: the
model, its physics and its classic images stay what they are.
"""

import functools
import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import AssetError
from duobench.core.spatial import SE3
from duobench.world.objects.shapes import Colour
from duobench.world.robot.gripper import GRIPPER
from duobench.world.scene.meshes import POINTS_PER_METRE

FILE = "robot_meshes_fine.npz"
"""The data, uncompressed, since wheels compress what they hold: `names` (k,), `images` (k,) and
`finishes` (k,), `counts` (k, 2) of vertices and triangles, and one mesh after the other `points`
(n, 3) on the grid, `normals` (n, 3) and `faces` (m, 3).
"""
SHA256 = "08d8342fcc056c335b4d3a1fc64419f7a94b8dee537a87c1798afb8223127faf"
"""Digest of the file: any other bytes are rejected."""
NORMAL_STEPS = 1000
"""Steps of one component of a normal, which are kept as whole numbers."""
PAD = "pad"
"""What the mesh of a pad stands for: the boxes that grasp, which no classic image shows."""

_ADVICE = "Install duobench again."
Floats = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True)
class Finish:
    """A surface, in the terms of physically based rendering."""

    rgba: Colour
    """Red, green, blue and opacity, each 0 to 1, as a screen shows them."""
    roughness: float
    """From 0, a mirror, to 1, chalk."""
    metallic: float = 0.0
    """Whether it is a metal, 0 or 1."""


FINISHES: Mapping[str, Finish] = {
    "cover": Finish(rgba=(0.93, 0.93, 0.92, 1.0), roughness=0.38),
    "trim": Finish(rgba=(0.16, 0.16, 0.17, 1.0), roughness=0.5),
    "letters": Finish(rgba=(0.86, 0.86, 0.86, 1.0), roughness=0.5),
    "button": Finish(rgba=(0.10, 0.35, 0.62, 1.0), roughness=0.4),
    "stop": Finish(rgba=(0.80, 0.07, 0.05, 1.0), roughness=0.4),
    "joint": Finish(rgba=(0.07, 0.07, 0.07, 1.0), roughness=0.8),
    "housing": Finish(rgba=(0.13, 0.13, 0.135, 1.0), roughness=0.45),
    "aluminium": Finish(rgba=(0.74, 0.75, 0.76, 1.0), roughness=0.34, metallic=1.0),
    "rubber": Finish(rgba=(0.06, 0.06, 0.06, 1.0), roughness=0.9),
}
"""Finishes by name: of the white covers and the black bands between them, of lettering, buttons
and the red plug, of the gap at a joint; and of the gripper's housing, links and pads."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FineMesh:
    """A mesh of one finish; its arrays become read-only, since meshes are shared."""

    name: str
    """Name, such as "fr3/link5_0/cover"."""
    image: str
    """Reduced mesh in whose place, and in whose frame, it is seen; or `PAD`."""
    finish: str
    """Name of its finish."""
    vertices: Floats
    """Vertices (n, 3) in metres."""
    normals: Floats
    """Unit normals (n, 3)."""
    faces: NDArray[np.uint32]
    """Triangles (m, 3), counter-clockwise from outside."""

    def __post_init__(self) -> None:
        for array in (self.vertices, self.normals, self.faces):
            array.setflags(write=False)


class FinePart(NamedTuple):
    """A fine mesh on a geom of a compiled model."""

    geom: int
    """Number of the geom, which it stands for and moves with."""
    mesh: FineMesh
    """The mesh, in the frame of the geom: `data.geom_xpos` and `data.geom_xmat` are its pose. It is
    the same object for all geoms that show it."""


@functools.cache
def fine_meshes() -> tuple[FineMesh, ...]:
    """Return all meshes, read once per process."""
    try:
        data = resources.files("duobench.world.scene").joinpath(FILE).read_bytes()
    except OSError as error:
        raise AssetError(
            f"The fine meshes of the robot cannot be read ({error}). {_ADVICE}"
        ) from error
    digest = hashlib.sha256(data).hexdigest()
    if digest != SHA256:
        raise AssetError(
            f"The fine meshes of the robot are damaged: {FILE} has the SHA-256 {digest}, "
            f"expected {SHA256}. {_ADVICE}"
        )
    return decode(data)


def decode(data: bytes) -> tuple[FineMesh, ...]:
    """Return the meshes that the bytes of a data file hold."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = dict(file)
    ends = arrays["counts"].cumsum(axis=0)[:-1]
    points = (arrays["points"] / POINTS_PER_METRE).astype(np.float32)
    normals = arrays["normals"].astype(np.float32)
    normals /= np.sqrt((normals * normals).sum(axis=1, keepdims=True))
    columns = zip(
        arrays["names"].tolist(),
        arrays["images"].tolist(),
        arrays["finishes"].tolist(),
        np.split(points, ends[:, 0]),
        np.split(normals, ends[:, 0]),
        np.split(arrays["faces"].astype(np.uint32), ends[:, 1]),
        strict=True,
    )
    return tuple(
        FineMesh(
            name=name,
            image=image,
            finish=finish,
            vertices=vertices,
            normals=directions,
            faces=faces,
        )
        for name, image, finish, vertices, directions, faces in columns
    )


def fine_parts(model: mujoco.MjModel) -> list[FinePart]:
    """Return what is seen of the robot of a compiled model, in the order of its geoms.

    The geoms with a part have none but these images; a renderer leaves their own away.
    """
    by_image: dict[str, list[FineMesh]] = {}
    for mesh in fine_meshes():
        by_image.setdefault(mesh.image, []).append(mesh)
    of_asset: dict[int, list[FineMesh]] = {}
    parts: list[FinePart] = []
    for geom, (asset, body) in enumerate(
        zip(model.geom_dataid.tolist(), model.geom_bodyid.tolist(), strict=True)
    ):
        if _is_first_of_pad(model, geom, body):
            parts += [FinePart(geom, mesh) for mesh in by_image[PAD]]
        elif model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            if asset not in of_asset:
                found = by_image.get(model.mesh(asset).name, [])
                of_asset[asset] = [_in_frame(mesh, model, asset) for mesh in found]
            parts += [FinePart(geom, mesh) for mesh in of_asset[asset]]
    return parts


def _is_first_of_pad(model: mujoco.MjModel, geom: int, body: int) -> bool:
    name = model.body(body).name.rpartition("/")[2]
    return name in GRIPPER.pads and model.body_geomadr[body] == geom


def _in_frame(mesh: FineMesh, model: mujoco.MjModel, asset: int) -> FineMesh:
    """A mesh in the frame to which the engine has turned the one that it stands for."""
    turn = SE3.from_wxyz(model.mesh_quat[asset], model.mesh_pos[asset]).inverse()
    return FineMesh(
        name=mesh.name,
        image=mesh.image,
        finish=mesh.finish,
        vertices=turn.apply(mesh.vertices).astype(np.float32),
        normals=(mesh.normals @ turn.rotation.T).astype(np.float32),
        faces=mesh.faces,
    )
