"""Finer images of the robot, for renderers that show how a surface takes the light.

They take the place of the reduced meshes of `scene.meshes` in a picture and nowhere else: the
model, its physics and its classic images stay what they are.
"""

import functools
import io
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.spatial import SE3
from duobench.world.objects.shapes import Colour
from duobench.world.scene.meshes import POINTS_PER_METRE, check_intact, shipped
from duobench.world.scene.surfaces import visual_only

FILE = "robot_meshes_fine.npz"
"""The data, uncompressed, since wheels compress what they hold: `images` (k,) and `finishes`
(k,), `counts` (k, 2) of vertices and triangles, and one mesh after the other `points` (n, 3) on the
grid, `normals` (n, 3) and `faces` (m, 3).
"""
SHA256 = "61410f8f8aeaa2bc00fec412ad2e6da66dc170a6df6ed75b069ec67e4f85c4ff"
"""Digest of the file: any other bytes are rejected."""
NORMAL_STEPS = 1000
"""Steps of one component of a normal, which are kept as whole numbers."""
PAD = "pad"
"""Image of a pad: of the boxes that grasp, which no classic image shows."""
_PADS = ("left_pad", "right_pad")
"""Bodies whose first geom it shows."""

Floats = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True)
class RobotFinish:
    """A surface, in the terms of physically based rendering."""

    rgba: Colour
    """Red, green, blue and opacity, each 0 to 1, as a screen shows them."""
    roughness: float
    """From 0, a mirror, to 1, chalk."""
    metallic: float = 0.0
    """Whether it is a metal, 0 or 1."""


COVER = "cover"
"""Finish of the white covers, which a look may paint."""
FINISHES: Mapping[str, RobotFinish] = {
    COVER: RobotFinish(rgba=(0.93, 0.93, 0.92, 1.0), roughness=0.38),
    "trim": RobotFinish(rgba=(0.16, 0.16, 0.17, 1.0), roughness=0.5),
    "letters": RobotFinish(rgba=(0.86, 0.86, 0.86, 1.0), roughness=0.5),
    "button": RobotFinish(rgba=(0.10, 0.35, 0.62, 1.0), roughness=0.4),
    "stop": RobotFinish(rgba=(0.80, 0.07, 0.05, 1.0), roughness=0.4),
    "joint": RobotFinish(rgba=(0.07, 0.07, 0.07, 1.0), roughness=0.8),
    "housing": RobotFinish(rgba=(0.13, 0.13, 0.135, 1.0), roughness=0.45),
    "aluminium": RobotFinish(
        rgba=(0.74, 0.75, 0.76, 1.0), roughness=0.34, metallic=1.0
    ),
    "rubber": RobotFinish(rgba=(0.06, 0.06, 0.06, 1.0), roughness=0.9),
}
"""Finishes by name: of the white covers and the black bands between them, of lettering, buttons
and the red plug, of the gap at a joint; and of the gripper's housing, links and pads."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FineMesh:
    """A mesh of one finish; its arrays become read-only, since meshes are shared."""

    image: str
    """Reduced mesh in whose place, and in whose frame, it is seen; or `PAD`."""
    finish: str
    """Name of its finish."""
    vertices: Floats
    """Vertices (n, 3) in metres."""
    normals: Floats
    """Unit normals (n, 3)."""
    faces: NDArray[np.int32]
    """Triangles (m, 3), counter-clockwise from outside."""

    def __post_init__(self) -> None:
        for array in (self.vertices, self.normals, self.faces):
            array.setflags(write=False)

    @property
    def name(self) -> str:
        """Name, such as "fr3/link5_0:visual/cover"."""
        return f"{self.image}/{self.finish}"


@functools.cache
def fine_meshes() -> tuple[FineMesh, ...]:
    """Return all meshes, read once per process."""
    return decode(shipped(FILE))


def decode(data: bytes) -> tuple[FineMesh, ...]:
    """Return the meshes that the bytes of the data file hold."""
    check_intact(data, FILE, SHA256)
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = dict(file)
    ends = arrays["counts"].cumsum(axis=0)[:-1]
    points = (arrays["points"] / POINTS_PER_METRE).astype(np.float32)
    normals = arrays["normals"].astype(np.float32)
    normals /= np.sqrt((normals * normals).sum(axis=1, keepdims=True))
    columns = zip(
        arrays["images"].tolist(),
        arrays["finishes"].tolist(),
        np.split(points, ends[:, 0]),
        np.split(normals, ends[:, 0]),
        np.split(arrays["faces"].astype(np.int32), ends[:, 1]),
        strict=True,
    )
    return tuple(
        FineMesh(
            image=image,
            finish=finish,
            vertices=vertices,
            normals=directions,
            faces=faces,
        )
        for image, finish, vertices, directions, faces in columns
    )


class FineRobot:
    """Fine images of the robot of a compiled model, as a model of images alone.

    Its geoms follow those of the robot, whose own images a renderer leaves away.

    Args:
        model: The compiled model.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        by_image: dict[str, list[FineMesh]] = {}
        for mesh in fine_meshes():
            by_image.setdefault(mesh.image, []).append(mesh)
        spec = mujoco.MjSpec()
        found: list[tuple[int, SE3, FineMesh]] = []
        for geom in range(model.ngeom):
            image, frame = _image(model, geom)
            found += [(geom, frame, mesh) for mesh in by_image.get(image, [])]
        for _, _, mesh in found:
            if spec.mesh(mesh.name) is None:
                spec.add_mesh(
                    name=mesh.name,
                    uservert=mesh.vertices.ravel(),
                    usernormal=mesh.normals.ravel(),
                    userface=mesh.faces.ravel(),
                    # It carries no mass, so it may be open.
                    inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
                )
            shown = spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=mesh.name,
                rgba=FINISHES[mesh.finish].rgba,
            )
            visual_only(shown)
        self.model = spec.compile()
        """Its geoms are in the order of those that they follow."""
        self.data = mujoco.MjData(self.model)
        """Where they are, once they have followed."""
        self.geoms = np.array([geom for geom, _, _ in found], dtype=np.int64)
        """For every geom, the one of the robot that it follows."""
        self.finishes = tuple(mesh.finish for _, _, mesh in found)
        """For every geom, the name of its finish."""
        offsets = [
            frame.inverse() @ _frame(self.model, asset)
            for (_, frame, _), asset in zip(found, self.model.geom_dataid, strict=True)
        ]
        shifts = np.array([offset.translation for offset in offsets])
        turns = np.array([offset.rotation for offset in offsets])
        self._shifts, self._turns = shifts.reshape(-1, 3), turns.reshape(-1, 3, 3)

    def follow(self, data: mujoco.MjData) -> None:
        """Take the poses of a state of the robot, whose kinematics are up to date."""
        turns = data.geom_xmat[self.geoms].reshape(-1, 3, 3)
        shifts = np.einsum("gij,gj->gi", turns, self._shifts)
        self.data.geom_xpos[:] = data.geom_xpos[self.geoms] + shifts
        turned = np.einsum("gij,gjk->gik", turns, self._turns)
        self.data.geom_xmat[:] = turned.reshape(-1, 9)


def _image(model: mujoco.MjModel, geom: int) -> tuple[str, SE3]:
    """Name of the image of a geom, and the pose of the geom in its frame."""
    body = int(model.geom_bodyid[geom])
    name = model.body(body).name.rpartition("/")[2]
    if name in _PADS and model.body_geomadr[body] == geom:
        return PAD, SE3()
    asset = int(model.geom_dataid[geom])
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH or asset < 0:
        return "", SE3()
    return model.mesh(asset).name, _frame(model, asset)


def _frame(model: mujoco.MjModel, asset: int) -> SE3:
    """The frame to which the engine has turned a mesh."""
    return SE3.from_wxyz(model.mesh_quat[asset], model.mesh_pos[asset])
