"""Geometry of a model for a browser: its triangles once, then a pose of each moving body.

The scene file is gzip over a uint32, the length of a JSON text; the text, which holds
`Geometry.header`; and for all n vertices, one plane after the other, position (float32 x y z,
metres), normal (int8 x y z) and emission (uint8, 255 is one), colour (uint8 red green blue) and
highlight (uint8, 255 is one), and the number of the body whose frame they are in (uint32, 0 is the
world, and 65536 is added where no shadow falls); then the corners of the triangles (int32), each as
the difference from the one before. Everything is little-endian; a vertex takes 24 bytes.
"""

import gzip
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import DuoBenchError
from duobench.core.spatial import SE3, matrix_from_wxyz, rotation_by
from duobench.core.types import Array
from duobench.web.shading import (
    as_camera,
    camera_of,
    cells_for,
    colours_of,
    emission_of,
    lights_of,
    texels_of,
)
from duobench.world.looks.clutter import pieces
from duobench.world.looks.look import CameraOffset, Look
from duobench.world.robot.cameras import CAMERAS, View
from duobench.world.scene.naming import FLOOR
from duobench.world.scene.surfaces import COLLISION_GEOM_GROUP, SHADOWLESS_GEOM_GROUP
from duobench.world.sim.appearance import Appearance

MAX_BODIES = 255
"""Most bodies that move; their poses have to fit into a block that every browser has."""

_GRAIN = 2.0**-15
"""Positions are multiples of this, 0.03 mm, so that they compress."""
_DIGITS = 6
"""Of poses and fields of view of the robot's cameras."""
_SPECULAR = 0.5
"""Specular reflection of a geom without material [MuJoCo's default]."""
_OPAQUE = 0.995
"""On what is less opaque no shadow falls [MuJoCo's renderer]."""
_NO_SHADOWS = 1 << 16
SLICES, STACKS = 16, 8
"""Fineness of what is round, about its axis and along it."""

_KIND = mujoco.mjtGeom


@dataclass(frozen=True, kw_only=True, slots=True)
class Triangles:
    """A surface, in the frame of its geom."""

    points: Array
    """Corners (n, 3) in metres."""
    normals: Array
    """Their unit normals (n, 3), outward."""
    corners: NDArray[np.int64]
    """Numbers of the corners of each triangle (m, 3), counter-clockwise from outside."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Surface:
    """A geom as a browser draws it."""

    order: tuple[int, ...]
    """Layer (0 room, 1 without shadow, 2 with), and what puts equal meshes beside each other."""
    shape: Triangles
    """Triangles in the frame of the body."""
    body: int
    """Its place in `Geometry.bodies` + 1, or 0 for the world."""
    colours: Array
    """Red, green and blue, 0 to 1, (n, 3)."""
    emission: float
    specular: float
    takes_shadows: bool


class Geometry:
    """A model as a browser shows it: as images of it look, without textures.

    What never moves is one part of the scene. A variant of a prop is what the model holds when this
    is made: after a layout with other variants, make another one. What is half transparent is shown
    opaque.

    Args:
        model: The compiled model; `Simulation.model`.
        look: How it looks; None is the scene as it was composed.
        view: Where people look from at first; None is the overview of the model.
        cameras: Whether the scene says where the robot's cameras are, so that a page can look
            through them.

    Raises:
        DuoBenchError: More than 255 bodies move, or a geom is of a kind that is not shown.
        UnknownNameError: The look names an object that the model has not.
        AssetError: An image file of the look cannot be read.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        look: Look | None = None,
        view: View | None = None,
        *,
        cameras: bool = False,
    ) -> None:
        is_visible = (model.geom_group < COLLISION_GEOM_GROUP) & (
            model.geom_rgba[:, 3] > 0
        )
        geoms = np.flatnonzero(is_visible).tolist()
        carriers = {
            geom: _carrier(model, int(model.geom_bodyid[geom])) for geom in geoms
        }
        self.bodies: tuple[int, ...] = tuple(
            sorted({root for root, _ in carriers.values()} - {0})
        )
        """Ids of the visible bodies that move, in the order of their poses."""
        if len(self.bodies) > MAX_BODIES:
            raise DuoBenchError(
                f"A browser is shown at most {MAX_BODIES} moving bodies, and this model has "
                f"{len(self.bodies)}."
            )
        self._ids = np.array(self.bodies, dtype=np.int64)
        look = look or Look()
        numbers = {0: 0} | {body: n for n, body in enumerate(self.bodies, start=1)}
        materials = Appearance(model, look)
        surfaces = [
            _surface(model, geom, numbers[root], pose, materials, look)
            for geom, (root, pose) in carriers.items()
        ]
        surfaces = sorted(
            [*surfaces, *_furniture(look)], key=lambda surface: surface.order
        )
        self.header: dict[str, Any] = {
            "format": 1,
            "vertices": sum(len(piece.shape.points) for piece in surfaces),
            "corners": sum(piece.shape.corners.size for piece in surfaces),
            "layers": [_size(surfaces, layer) for layer in range(3)],
            "bodies": len(self.bodies),
            "camera": camera_of(model) if view is None else as_camera(view),
            **lights_of(model, look),
        }
        """Counts; corners of the room, of what else casts no shadow, and of what does; camera for
        people; lights; and, where asked for, the robot's cameras."""
        if cameras:
            self.header["cameras"] = _cameras(model, look, numbers)
        self.data: bytes = _packed(self.header, surfaces)
        """The scene file."""
        self.name: str = hashlib.sha256(self.data).hexdigest()[:12]
        """Name that only scenes with the same file have in common."""

    def poses(self, data: mujoco.MjData) -> NDArray[np.float32]:
        """Poses of the bodies in a state with up-to-date kinematics.

        Returns:
            New array (bodies, 7): position x y z in metres, quaternion w x y z, in the table frame.
        """
        found = np.empty((len(self._ids), 7), dtype=np.float32)
        found[:, :3] = data.xpos[self._ids]
        found[:, 3:] = data.xquat[self._ids]
        return found


def _cameras(
    model: mujoco.MjModel,
    look: Look,
    numbers: Mapping[int, int],
) -> list[dict[str, Any]]:
    """The robot's cameras, where the look has them.

    Of each its `name`; the number of the `body` with which it moves, and in the frame of that one
    its `pose`, x y z and w x y z, with MuJoCo's axes; `fovy`, its vertical field of view in
    degrees; and `aspect`, width by height.
    """
    found = []
    for name, camera in CAMERAS.items():
        number = model.camera(name).id
        root, carrier_from_body = _carrier(model, int(model.cam_bodyid[number]))
        offset = look.cameras.get(name, CameraOffset())
        pose = (
            carrier_from_body
            @ _pose(model.cam_pos[number], model.cam_quat[number])
            @ SE3(rotation_by(np.array(offset.rotation)), np.array(offset.position))
        )
        height, width = camera.size
        fovy = 2 * math.atan(height / 2 / camera.focal) + offset.field_of_view
        found.append(
            {
                "name": name,
                "body": numbers[root],
                "pose": [
                    *pose.translation.round(_DIGITS).tolist(),
                    *pose.wxyz.round(_DIGITS).tolist(),
                ],
                "fovy": round(math.degrees(fovy), _DIGITS),
                "aspect": round(width / height, _DIGITS),
            }
        )
    return found


def _carrier(model: mujoco.MjModel, body: int) -> tuple[int, SE3]:
    """The body with whose frame a body moves, 0 for one that stands still, and its pose therein."""
    pose = SE3()
    while body and not model.body_jntnum[body] and model.body_mocapid[body] < 0:
        pose = _pose(model.body_pos[body], model.body_quat[body]) @ pose
        body = int(model.body_parentid[body])
    return body, pose


def _pose(position: Array, wxyz: Array) -> SE3:
    return SE3(matrix_from_wxyz(wxyz), position)


def _surface(
    model: mujoco.MjModel,
    geom: int,
    body: int,
    carrier_from_body: SE3,
    materials: Appearance,
    look: Look,
) -> _Surface:
    body_from_geom = _pose(model.geom_pos[geom], model.geom_quat[geom])
    texels = texels_of(model, geom, materials)
    surface = triangles_of(model, geom, cells_for(texels))
    is_matte = model.geom_group[geom] == SHADOWLESS_GEOM_GROUP
    owner = int(model.geom_bodyid[geom])
    is_room = is_matte and (owner == 0 or model.body(owner).name == FLOOR)
    material = int(model.geom_matid[geom])
    return _Surface(
        order=(
            0 if is_room else 1 if is_matte else 2,
            int(model.geom_type[geom]),
            int(model.geom_dataid[geom]),
            geom,
        ),
        shape=_moved(surface, carrier_from_body @ body_from_geom),
        body=body,
        colours=colours_of(model, geom, surface.points, materials, texels),
        emission=emission_of(model, material, look),
        specular=_SPECULAR if material < 0 else float(model.mat_specular[material]),
        takes_shadows=bool(model.geom_rgba[geom, 3] >= _OPAQUE),
    )


def _furniture(look: Look) -> Iterator[_Surface]:
    """The furniture of a look, which is no part of the model."""
    for number, piece in enumerate(pieces(look.clutter, look.seed)):
        size = [side / 2 for side in piece.size]
        shape = _cylinder(size[0], size[2]) if piece.is_round else _box(*size)
        yield _Surface(
            order=(0, -1, -1, number),
            shape=_moved(shape, SE3.at(*piece.position)),
            body=0,
            colours=np.broadcast_to(np.array(piece.colour), (len(shape.points), 3)),
            emission=0.0,
            specular=0.0,
            takes_shadows=True,
        )


def _moved(shape: Triangles, pose: SE3) -> Triangles:
    rotation = np.asarray(pose.rotation)
    return Triangles(
        points=pose.apply(shape.points),
        normals=shape.normals @ rotation.T,
        corners=shape.corners,
    )


def _size(surfaces: list[_Surface], layer: int) -> int:
    return sum(
        piece.shape.corners.size for piece in surfaces if piece.order[0] == layer
    )


def _packed(header: dict[str, Any], surfaces: list[_Surface]) -> bytes:
    counts = [len(piece.shape.points) for piece in surfaces]
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]).tolist()
    points = np.concatenate([piece.shape.points for piece in surfaces])
    normals = np.concatenate([piece.shape.normals for piece in surfaces])
    colours = np.concatenate([piece.colours for piece in surfaces])
    corners = np.concatenate(
        [
            start + piece.shape.corners.ravel()
            for start, piece in zip(starts, surfaces, strict=True)
        ]
    )
    emission = np.repeat([_byte(piece.emission) for piece in surfaces], counts)
    specular = np.repeat([_byte(piece.specular) for piece in surfaces], counts)
    numbers = [
        piece.body + (0 if piece.takes_shadows else _NO_SHADOWS) for piece in surfaces
    ]
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    planes = (
        (np.rint(points / _GRAIN) * _GRAIN).astype("<f4"),
        np.column_stack(
            [np.rint(127 * normals).astype(np.int8).view(np.uint8), emission]
        ),
        np.column_stack([_byte(colours), specular]),
        np.repeat(numbers, counts).astype("<u4"),
        np.diff(corners, prepend=0).astype("<i4"),
    )
    parts = [
        len(text).to_bytes(4, "little"),
        text,
        *(plane.tobytes() for plane in planes),
    ]
    return gzip.compress(b"".join(parts), compresslevel=9, mtime=0)


def _byte(value: Array | float) -> NDArray[np.uint8]:
    return np.rint(255 * np.clip(value, 0.0, 1.0)).astype(np.uint8)


def triangles_of(
    model: mujoco.MjModel, geom: int, cells: tuple[int, int] = (1, 1)
) -> Triangles:
    """The surface of a geom.

    Args:
        model: The model.
        geom: Its id.
        cells: Into how many cells a plane is cut along x and y, so that its colour can change from
            corner to corner.

    Raises:
        DuoBenchError: It is a height field or a signed distance field, which have no such surface.
    """
    kind = int(model.geom_type[geom])
    if kind == _KIND.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    x, y, z = model.geom_size[geom].tolist()
    makers = {
        _KIND.mjGEOM_PLANE.value: lambda: _plane(x, y, cells),
        _KIND.mjGEOM_BOX.value: lambda: _box(x, y, z),
        _KIND.mjGEOM_SPHERE.value: lambda: _ellipsoid(x, x, x),
        _KIND.mjGEOM_ELLIPSOID.value: lambda: _ellipsoid(x, y, z),
        _KIND.mjGEOM_CYLINDER.value: lambda: _cylinder(x, y),
        _KIND.mjGEOM_CAPSULE.value: lambda: _capsule(x, y),
    }
    if kind not in makers:
        name = _KIND(kind).name.removeprefix("mjGEOM_").lower()
        raise DuoBenchError(
            f"The geom {model.geom(geom).name!r} is a {name}, which a browser is not shown; what "
            "works is plane, box, sphere, ellipsoid, cylinder, capsule and mesh."
        )
    return makers[kind]()


def _cylinder(radius: float, half_height: float) -> Triangles:
    return _revolved(
        [(0, -1), (1, -1), (1, -1), (1, 1), (1, 1), (0, 1)],
        [(0, -1), (0, -1), (1, 0), (1, 0), (0, 1), (0, 1)],
        (radius, half_height),
    )


def _mesh(model: mujoco.MjModel, mesh: int) -> Triangles:
    """A mesh of the model; corners that share place and normal are one."""
    faces = slice(
        model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh]
    )
    pairs = np.stack([model.mesh_face[faces], model.mesh_facenormal[faces]], axis=-1)
    unique, corners = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    return Triangles(
        points=model.mesh_vert[model.mesh_vertadr[mesh] + unique[:, 0]].astype(
            np.float64
        ),
        normals=model.mesh_normal[model.mesh_normaladr[mesh] + unique[:, 1]].astype(
            np.float64
        ),
        corners=corners.reshape(-1, 3).astype(np.int64),
    )


def _plane(
    half_x: float,
    half_y: float,
    cells: tuple[int, int],
) -> Triangles:
    """A plane that faces along z; one without end reaches 10 m."""
    along_x, along_y = (np.linspace(-1.0, 1.0, count + 1) for count in cells)
    x, y = np.meshgrid(
        along_x * (half_x or 10.0), along_y * (half_y or 10.0), indexing="ij"
    )
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    normals = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
    return Triangles(points=points, normals=normals, corners=_grid(*x.shape))


def _box(
    x: float,
    y: float,
    z: float,
) -> Triangles:
    points = []
    normals = []
    corners = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = sign * np.eye(3)[axis]
            u = np.eye(3)[(axis + 1) % 3]
            v = np.cross(normal, u)
            corners += [
                [len(points) + i for i in face] for face in ((0, 1, 2), (0, 2, 3))
            ]
            points += [normal - u - v, normal + u - v, normal + u + v, normal - u + v]
            normals += [normal] * 4
    return Triangles(
        points=np.array(points) * (x, y, z),
        normals=np.array(normals),
        corners=np.array(corners),
    )


def _ellipsoid(
    x: float,
    y: float,
    z: float,
) -> Triangles:
    angles = np.linspace(-np.pi / 2, np.pi / 2, STACKS + 1)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    ball = _revolved(circle, circle, (1.0, 1.0))
    normals = ball.points / (x, y, z)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Triangles(
        points=ball.points * (x, y, z), normals=normals, corners=ball.corners
    )


def _capsule(radius: float, half_height: float) -> Triangles:
    quarter = np.linspace(0.0, np.pi / 2, STACKS // 2 + 1)
    angles = np.concatenate([quarter - np.pi / 2, quarter])
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    ends = np.repeat([-half_height, half_height], len(quarter))
    profile = radius * circle + np.stack([np.zeros_like(ends), ends], axis=-1)
    return _revolved(profile, circle, (1.0, 1.0))


def _revolved(
    profile: object, normals: object, scale: tuple[float, float]
) -> Triangles:
    """The surface that a line (n, 2) in the plane of radius and z sweeps about z, from below up."""
    line, across = (np.asarray(each, dtype=np.float64) for each in (profile, normals))
    angles = np.linspace(0.0, 2 * np.pi, SLICES + 1)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1)

    def swept(points: Array) -> Array:
        turned = points[None, :, :1] * around[:, None, :]
        up = np.broadcast_to(points[None, :, 1:], (*turned.shape[:2], 1))
        return np.concatenate([turned, up], axis=-1).reshape(-1, 3)

    return Triangles(
        points=swept(line * scale),
        normals=swept(across),
        corners=_grid(len(angles), len(line)),
    )


def _grid(rows: int, columns: int) -> NDArray[np.int64]:
    """Triangles (m, 3) between the neighbours of a grid of points, numbered row by row."""
    at = np.arange(rows * columns).reshape(rows, columns)
    a = at[:-1, :-1]
    b = at[1:, :-1]
    c = at[1:, 1:]
    d = at[:-1, 1:]
    return np.concatenate(
        [
            np.stack([a, b, c], axis=-1).reshape(-1, 3),
            np.stack([a, c, d], axis=-1).reshape(-1, 3),
        ]
    )
