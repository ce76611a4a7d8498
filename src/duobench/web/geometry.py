"""What a browser needs to show a model: its triangles once, then a pose of each moving body.

The scene file is gzip over a uint32, the length of a JSON text; the text, which holds
`Geometry.header`; and for all n vertices, one plane after the other, position (float32 x y z,
metres), normal (int8 x y z) and emission (uint8, 255 is one), colour (uint8 red green blue) and
highlight (uint8, 255 is one), and the number of the body whose frame they are in (uint32, 0 is the
world, and 65536 is added where no shadow falls); then the corners of the triangles (int32), each as
the difference from the one before. Everything is little-endian; a vertex takes 24 bytes.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.errors import DuoBenchError
from duobench.looks.clutter import pieces
from duobench.looks.look import Look
from duobench.scene.naming import FLOOR
from duobench.scene.surfaces import COLLISION_GEOM_GROUP, SHADOWLESS_GEOM_GROUP
from duobench.sim.materials import GeomMaterials, resolve_materials
from duobench.spatial import SE3, matrix_from_wxyz
from duobench.types import Array
from duobench.web.colours import cells_for, colours_of, texels_of
from duobench.web.lighting import camera_of, emission_of, lights_of
from duobench.web.shapes import Triangles, box, cylinder, triangles_of

MAX_BODIES = 255
"""Most bodies that move; their poses have to fit into a block that every browser has."""

_GRAIN = 2.0**-15
"""Positions are multiples of this, 0.03 mm, so that they compress."""
_SPECULAR = 0.5
"""Of a geom without material [MuJoCo's default]."""
_OPAQUE = 0.995
"""On what is less opaque no shadow falls [MuJoCo's renderer]."""
_NO_SHADOWS = 1 << 16


@dataclass(frozen=True, kw_only=True, slots=True)
class _Piece:
    """A geom as it is shown."""

    order: tuple[int, ...]
    """Layer (0 room, 1 without shadow, 2 with), and what puts equal meshes beside each other."""
    shape: Triangles
    """In the frame of the body."""
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
    """

    def __init__(self, model: mujoco.MjModel, look: Look | None = None) -> None:
        """Collect what is seen.

        Args:
            model: The compiled model; `Simulation.model`.
            look: How it looks; None is the scene as it was composed.

        Raises:
            DuoBenchError: More than 255 bodies move, or a geom is of a kind that is not shown.
            UnknownNameError: The look names an object that the model has not.
            AssetError: An image file of the look cannot be read.
        """
        seen = (model.geom_group < COLLISION_GEOM_GROUP) & (model.geom_rgba[:, 3] > 0)
        geoms = np.flatnonzero(seen).tolist()
        carriers = {geom: _carrier(model, int(model.geom_bodyid[geom])) for geom in geoms}
        self.bodies: tuple[int, ...] = tuple(sorted({root for root, _ in carriers.values()} - {0}))
        """Ids of the bodies that move and are seen, in the order of their poses."""
        if len(self.bodies) > MAX_BODIES:
            raise DuoBenchError(
                f"A browser is shown at most {MAX_BODIES} moving bodies, and this model has "
                f"{len(self.bodies)}."
            )
        self._ids = np.array(self.bodies, dtype=np.int64)
        look = look or Look()
        numbers = {0: 0} | {body: n for n, body in enumerate(self.bodies, start=1)}
        materials = GeomMaterials() if look == Look() else resolve_materials(model, look)
        shown = [
            _shown(model, geom, numbers[root], pose, materials, look)
            for geom, (root, pose) in carriers.items()
        ]
        shown = sorted([*shown, *_furniture(look)], key=lambda piece: piece.order)
        self.header: dict[str, Any] = {
            "format": 1,
            "vertices": sum(len(piece.shape.points) for piece in shown),
            "corners": sum(piece.shape.corners.size for piece in shown),
            "layers": [_size(shown, layer) for layer in range(3)],
            "bodies": len(self.bodies),
            "camera": camera_of(model),
            **lights_of(model, look),
        }
        """Counts; corners of the room, of what else casts no shadow, and of what does; camera for
        people; lights."""
        self.data: bytes = _packed(self.header, shown)
        """The scene file."""
        self.name: str = hashlib.sha256(self.data).hexdigest()[:12]
        """What only scenes with the same file have in common."""

    def poses(self, data: mujoco.MjData) -> NDArray[np.float32]:
        """Where the bodies are.

        Args:
            data: State of the model, with up-to-date kinematics.

        Returns:
            New array (bodies, 7): position x y z in metres, quaternion w x y z, in the table frame.
        """
        found = np.empty((len(self._ids), 7), dtype=np.float32)
        found[:, :3] = data.xpos[self._ids]
        found[:, 3:] = data.xquat[self._ids]
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


def _shown(
    model: mujoco.MjModel,
    geom: int,
    body: int,
    carrier_from_body: SE3,
    materials: GeomMaterials,
    look: Look,
) -> _Piece:
    """A geom of the model."""
    body_from_geom = _pose(model.geom_pos[geom], model.geom_quat[geom])
    texels = texels_of(model, geom, materials)
    surface = triangles_of(model, geom, cells_for(texels))
    is_matte = model.geom_group[geom] == SHADOWLESS_GEOM_GROUP
    owner = int(model.geom_bodyid[geom])
    is_room = is_matte and (owner == 0 or model.body(owner).name == FLOOR)
    material = int(model.geom_matid[geom])
    return _Piece(
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


def _furniture(look: Look) -> Iterator[_Piece]:
    """The furniture of a look, which is no part of the model."""
    for number, piece in enumerate(pieces(look.clutter, look.seed)):
        width, _, height = piece.size
        shape = cylinder(width / 2, height / 2) if piece.is_round else box(piece.size)
        yield _Piece(
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
        points=pose.apply(shape.points), normals=shape.normals @ rotation.T, corners=shape.corners
    )


def _size(shown: list[_Piece], layer: int) -> int:
    return sum(piece.shape.corners.size for piece in shown if piece.order[0] == layer)


def _packed(header: dict[str, Any], shown: list[_Piece]) -> bytes:
    counts = [len(piece.shape.points) for piece in shown]
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]).tolist()
    points = np.concatenate([piece.shape.points for piece in shown])
    normals = np.concatenate([piece.shape.normals for piece in shown])
    colours = np.concatenate([piece.colours for piece in shown])
    corners = np.concatenate(
        [start + piece.shape.corners.ravel() for start, piece in zip(starts, shown, strict=True)]
    )
    emission = np.repeat([_byte(piece.emission) for piece in shown], counts)
    specular = np.repeat([_byte(piece.specular) for piece in shown], counts)
    numbers = [piece.body + (0 if piece.takes_shadows else _NO_SHADOWS) for piece in shown]
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    planes = (
        (np.rint(points / _GRAIN) * _GRAIN).astype("<f4"),
        np.column_stack([np.rint(127 * normals).astype(np.int8).view(np.uint8), emission]),
        np.column_stack([_byte(colours), specular]),
        np.repeat(numbers, counts).astype("<u4"),
        np.diff(corners, prepend=0).astype("<i4"),
    )
    parts = [len(text).to_bytes(4, "little"), text, *(plane.tobytes() for plane in planes)]
    return gzip.compress(b"".join(parts), compresslevel=9, mtime=0)


def _byte(value: Array | float) -> NDArray[np.uint8]:
    return np.rint(255 * np.clip(value, 0.0, 1.0)).astype(np.uint8)
